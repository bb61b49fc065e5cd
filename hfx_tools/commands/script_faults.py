# SPDX-License-Identifier: GPL-3.0-or-later
"""Faults of device scripts: of their text, and of a trial that calls them."""

from __future__ import annotations

import ast
import inspect
import json
import symtable
import tempfile
import time
import warnings
from dataclasses import dataclass
from pathlib import Path
from types import CodeType
from typing import Final

import numpy as np

from hfx_blender.devices.host.output import PATIENCE_S
from hfx_blender.devices.live.approval import DeviceScript, compiled
from hfx_blender.devices.script_rendering import PRINTED, ScriptFaultError, ScriptRun
from hfx_blender.devices.workers.haptics import encode_haptics
from hfx_blender.devices.workers.script_process import READY_S
from hfx_blender.engine.arrays import F64
from hfx_blender.engine.body.model import manifest
from hfx_blender.engine.modality import MODALITIES
from hfx_blender.engine.rendering.device_config import DeviceConfig
from hfx_blender.engine.samples import SampleRun, Stream
from hfx_blender.errors import InputError
from hfx_blender.files import resources
from hfx_blender.processes.messages import MessageKind, message

_ENTRY: Final = "render"
_NO_ENTRY: Final = "has no function render(haptics)"
# Names by which a module can bind names that its text does not show.
_BINDERS: Final = {
    *("exec", "eval", "globals", "locals", "vars", "setattr", "*"),
    *("__globals__", "f_globals", "f_locals"),
}
_STEP_S: Final = 0.01  # time between two calls of a trial, seconds; no jump for the script
_VERTICES: Final = 8

Felt = list[tuple[SampleRun, F64]]


@dataclass(frozen=True)
class Trial:
    """Result of a trial: the fault that ended it, "" for none; notes, such as printed lines."""

    fault: str
    notes: list[str]


def text_faults(script: Path) -> list[str]:
    """Faults that the text of a script shows, a sentence each; runs none of its code.

    The script is compiled, and must bind ``render`` in its module: as a function that takes one
    argument, or as another name that is no constant. A script that may bind ``render`` at run
    time, as by ``exec``, needs a trial instead.
    """
    try:
        source = script.read_bytes()
        code = compiled(source, script)
        with warnings.catch_warnings(action="ignore"):  # of invalid escapes, for example
            tree = ast.parse(source, str(script))
            table = symtable.symtable(source, str(script), "exec")
    except OSError as error:
        return [f"{script}: cannot be read ({error.strerror})."]
    except InputError as error:
        return [str(error)]
    except (RecursionError, MemoryError):  # compiles, but is too deep for a tree
        return []
    if _binds_at_run_time(tree):
        return []
    fault = _entry_fault(tree, table, code)
    return [f"{script}{fault}."] if fault else []


def _binds_at_run_time(tree: ast.Module) -> bool:
    """Test for code that can bind ``render`` at run time, such as ``exec`` or ``global render``."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Global) and _ENTRY in node.names:
            return True
        # Names, attributes as in ``builtins.exec``, and imported names.
        names = {getattr(node, field, None) for field in ("id", "attr", "name")}
        if names & _BINDERS:
            return True
    return False


def _entry_fault(tree: ast.Module, table: symtable.SymbolTable, code: CodeType) -> str:
    """Fault of the binding of ``render`` in a module, from the place on; "" for none."""
    names = table.get_identifiers()
    symbol = table.lookup(_ENTRY) if _ENTRY in names else None
    if symbol is None or not (symbol.is_assigned() or symbol.is_imported()):
        return f": {_NO_ENTRY}"
    # Only statements of the module itself are certain; the last one that binds the name counts.
    last = next((node for node in reversed(tree.body) if _may_bind(node)), None)
    place = f", line {last.lineno}: " if last is not None else ""
    match last:
        case ast.AsyncFunctionDef(name=name) if name == _ENTRY:
            return f"{place}'render' is an 'async' function; 'def' is allowed"
        case ast.FunctionDef(name=name, decorator_list=[]) if name == _ENTRY:
            if _is_generator(last, code):
                return f"{place}'render' is a generator; 'return' in place of 'yield' is allowed"
            return _arguments_fault(last.args, place)
        case ast.Assign(value=value) if _ENTRY in _names(last.targets):
            if isinstance(value, ast.Lambda):
                return _arguments_fault(value.args, place)
            is_constant = isinstance(value, ast.Constant)
            return f"{place}'render' is a constant, not a function" if is_constant else ""
        case ast.Delete() if _ENTRY in _names(last.targets):
            return f"{place}'render' is deleted, so the script {_NO_ENTRY}"
    return ""


def _may_bind(statement: ast.stmt) -> bool:
    """Test for a binding or deletion of ``render`` at any depth of a statement."""
    return any(
        _ENTRY in {getattr(node, field, None) for field in ("name", "asname", "rest")}
        or (isinstance(node, ast.Name) and node.id == _ENTRY and not isinstance(node.ctx, ast.Load))
        for node in ast.walk(statement)
    )


def _names(targets: list[ast.expr]) -> set[str]:
    """Names that an assignment or a deletion binds or removes."""
    return {target.id for target in targets if isinstance(target, ast.Name)}


def _is_generator(function: ast.FunctionDef, code: CodeType) -> bool:
    """Test that a function of the module ``code`` has a ``yield`` of its own."""
    return any(
        isinstance(inner, CodeType)
        and (inner.co_name, inner.co_firstlineno) == (function.name, function.lineno)
        and bool(inner.co_flags & inspect.CO_GENERATOR)
        for inner in code.co_consts
    )


def _arguments_fault(arguments: ast.arguments, place: str) -> str:
    """Fault of a function that cannot be called with one argument, after ``place``; "" for none."""
    most = len(arguments.posonlyargs) + len(arguments.args)
    least = most - len(arguments.defaults)
    required = [
        argument.arg
        for argument, default in zip(arguments.kwonlyargs, arguments.kw_defaults, strict=True)
        if default is None
    ]
    if least <= 1 and (most >= 1 or arguments.vararg) and not required:
        return ""
    needed = f"{least} arguments" if not required else f"the keyword '{required[0]}'"
    return f"{place}'render' takes {needed}; it is called with one, 'haptics'"


def try_script(script: DeviceScript, device: DeviceConfig) -> Trial:
    """Call a script in its own process: in silence, with an effect of each modality at all
    actuators, then with all of them.

    Runs the script with the rights of the user, approved or not. The fault names the call.
    """
    calls = _calls(device)
    answers = np.zeros((len(calls), len(device.neutral)))
    printed: list[str] = []
    slowest_s, fault, called = 0.0, "", ""
    with tempfile.TemporaryDirectory() as folder:
        variables = None if script.is_approved else _approved_for_trial(script, Path(folder))
        began = time.monotonic()
        try:
            with ScriptRun(script, device, answers, printed, variables) as run:
                run.wait()
                start_s = time.monotonic() - began
                for k, (name, felt, values) in enumerate(calls):
                    called = f" failed when called with {name}:"
                    haptics = encode_haptics(k * _STEP_S, felt, values)
                    began = time.monotonic()
                    run.ask([message(MessageKind.HAPTICS, 0, haptics)])
                    run.wait()
                    slowest_s = max(slowest_s, time.monotonic() - began)
        except ScriptFaultError as error:
            reason = str(error).removesuffix(".")
            fault = f"{script.path}:{called} {reason}."
    notes = [f"its script printed: {line}" for line in printed[:PRINTED]]
    if len(printed) > PRINTED:
        notes.append(f"its script printed {len(printed) - PRINTED} more lines")
    if fault:
        return Trial(fault, notes)
    if (unfinite := int(np.count_nonzero(~np.isfinite(answers).all(axis=1)))) > 0:
        notes.append(
            f"its script gave no number in {unfinite} of {len(calls)} calls; actuators are silent "
            "then"
        )
    if start_s > READY_S:
        notes.append(f"its script took {start_s:.1f} s to start; {READY_S:g} s are allowed live")
    if slowest_s > PATIENCE_S:
        notes.append(
            f"a call of its script took {slowest_s:.2f} s; {PATIENCE_S:g} s are allowed live"
        )
    return Trial("", notes)


def _approved_for_trial(script: DeviceScript, folder: Path) -> dict[str, str]:
    """Environment variables of a worker whose list of approvals, in ``folder``, holds this script
    alone. The user's list stays as it is."""
    entry = {script.fingerprint: str(script.path)}
    (folder / resources.approved_scripts().name).write_text(json.dumps(entry))
    return {resources.USER_DATA_VARIABLE: str(folder)}


def _calls(device: DeviceConfig) -> list[tuple[str, Felt, F64]]:
    """Calls of a trial: a name, effects on the wearer, and values without the script."""
    runs = {name: _full_effect(name, device) for name in MODALITIES}
    calls: list[tuple[str, Felt, F64]] = [("no effect", [], device.neutral)]
    for name, run in runs.items():
        calls.append((f"an effect of {name}", [run], _full_values(device, [name])))
    felt = list(runs.values())
    return [*calls, ("effects of all modalities", felt, _full_values(device, list(runs)))]


def _full_effect(modality: str, device: DeviceConfig) -> tuple[SampleRun, F64]:
    """Effect of full strength at a few vertices, with default parameters; gain 1 at all
    actuators."""
    models = manifest()["models"].items()
    used = MODALITIES[modality].model
    model_id = next(id for id, model in models if model["modality"] == used)
    run = SampleRun(
        Stream(f"trial_{modality}", "trial", modality, model_id),
        indices=np.array([0]),
        times_s=np.zeros(1),
        levels=np.ones(1),
        parameters=np.array([[p.default for p in MODALITIES[modality].parameters]]),
        offsets=np.array([0, _VERTICES]),
        vertices=np.arange(_VERTICES, dtype=np.int32),
        weights=np.ones(_VERTICES, np.float32),
    )
    return run, np.ones(len(device.actuators))


def _full_values(device: DeviceConfig, modalities: list[str]) -> F64:
    """Values (columns,) with the largest strength at the actuators of the modalities."""
    values = device.neutral
    column = 0
    for actuator in device.actuators:
        for control in actuator.type.controls:
            is_driven = actuator.type.modality in modalities
            if is_driven and control.name == actuator.type.strength.name:
                values[column] = control.highest
            column += 1
    return values


def script_faults(script: DeviceScript | None, device: DeviceConfig, is_tried: bool) -> Trial:
    """First fault of a device's script, and notes; without a script neither.

    A script that is approved is tried, another script only if ``is_tried``.
    """
    if script is None:
        return Trial("", [])
    if faults := text_faults(script.path):
        return Trial(faults[0], [])
    if script.is_approved or is_tried:
        return try_script(script, device)
    return Trial("", [])


def refuse_faulty_script(script: DeviceScript, device: DeviceConfig, is_tried: bool) -> list[str]:
    """Notes on a script without faults; raises InputError: a fault of :func:`script_faults`."""
    trial = script_faults(script, device, is_tried)
    if trial.fault:
        raise InputError(trial.fault)
    return trial.notes
