# SPDX-License-Identifier: GPL-3.0-or-later
"""Memory limits for small files with large claims, and no output of invalid files."""

from __future__ import annotations

import io
import json
import math
import struct
import tracemalloc
import zipfile
import zlib
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from format_cases import raster_for, signal
from test_hjif import BEAT, sample, track_of

from hfx_blender import cli
from hfx_blender.devices.configuration import load_device
from hfx_blender.engine.body import model
from hfx_blender.engine.body.model import PerceptualModel, load
from hfx_blender.engine.scene import TimeBase
from hfx_blender.engine.track import TrackReader, TrackWriter
from hfx_blender.errors import InputError, OutputError
from hfx_blender.files import limits
from hfx_blender.files.limits import TooLargeError
from hfx_blender.files.staging import staging
from hfx_blender.formats import files
from hfx_blender.formats.device_files import ahap as ahap_format
from hfx_blender.formats.device_files import ahap_rules, tact
from hfx_blender.formats.pictures import png
from hfx_blender.formats.rasters import csv_raster, npz_raster
from hfx_blender.formats.registry import FORMATS
from hfx_blender.formats.signals.curves import Curve
from hfx_blender.formats.signals.signals import FrequencyRange, Piece, Signal, mixed
from hfx_blender.formats.writing import write_signals
from hfx_tools.commands import conversion
from hfx_tools.commands.conversion import convert
from hfx_tools.formats import npz_reader
from hfx_tools.formats.validation import validate

MOST_BYTES = 24 << 20  # limit of a refusal


def refused(ask, match):
    """Expect a refusal with a message, before memory is allocated."""
    tracemalloc.start()
    try:
        with pytest.raises(InputError, match=match):
            ask()
        assert tracemalloc.get_traced_memory()[1] < MOST_BYTES
    finally:
        tracemalloc.stop()


def haptic(seconds):
    points = [{"time": t, "amplitude": 0.5} for t in (0.0, seconds)]
    envelopes = {"amplitude": points, "frequency": []}
    return {"version": {"major": 1}, "signals": {"continuous": {"envelopes": envelopes}}}


def ahap(seconds):
    event = {"Time": seconds, "EventType": "HapticTransient", "EventParameters": []}
    return {"Version": 1.0, "Pattern": [{"Event": event}]}


def hjif(ticks):
    document = sample()
    for perception in document["perceptions"]:
        for channel in perception["channels"]:
            channel["bands"] = [b for b in channel["bands"] if b["band_type"] != "WaveletWave"]
            for band in channel["bands"]:
                band["effects"] = [
                    {
                        "effect_type": "Basis",
                        "position": ticks,
                        "phase": 0.0,
                        "base_signal": "Sine",
                        "keyframes": [{"relative_position": 0, "amplitude_modulation": 0.5}],
                    }
                ]
    return document


def openxr(ns):
    points = [{"time": 0, "value": 0.5}, {"time": 1, "value": 0.5}]
    frame = {"start": ns, "streamFrameType": "NONE", "amplitudePoints": points}
    channels = [{"actuator": "a", "frames": [frame]}]
    head = {"format": "hfx-openxr-parametric", "version": 1}
    return {**head, "minFrequencyHz": 50, "maxFrequencyHz": 200, "channels": channels}


def he(ms):
    parameters = {"Intensity": 50, "Frequency": 50}
    event = {"Type": "transient", "RelativeTime": 0, "Index": 0, "Parameters": parameters}
    pattern = {"AbsoluteTime": ms, "Pattern": [{"Event": event}]}
    return {"Metadata": {"Version": 2}, "PatternList": [pattern]}


LATE = {
    "x.haptic": haptic(2e5),
    "x.ahap": ahap(9.7e5),
    "x.hjif": hjif(2**63),
    "x.openxr.json": openxr(2**60),
    "x.he": he(2**31 - 1),
}


@pytest.mark.parametrize("name", LATE)
@pytest.mark.parametrize("target", ["he", "hjif", "csv"])
def test_a_few_bytes_that_last_for_days_are_refused(tmp_path, name, target):
    path = tmp_path / name
    path.write_text(json.dumps(LATE[name]))
    device = "back_pad" if target in ("csv", "tact") else None
    pieces_folder = tmp_path / "made"
    refused(lambda: convert(path, pieces_folder, to=target, device=device), r"allowed are 86,400 s")
    assert [path.name for path in tmp_path.iterdir()] == [name]
    actual, findings = validate(path)
    assert [finding.severity for finding in findings if finding.code.endswith("-LARGE")] == [
        "error"
    ], actual


def test_more_is_allowed_by_an_option_and_by_a_context(tmp_path, capsys):
    path = tmp_path / "x.ahap"
    path.write_text(json.dumps(ahap(100_000.0)))
    text = str(tmp_path / "y.haptic")
    assert cli.run(["convert", str(path), text]) == 3
    assert "'--largest 1.2' allows it" in capsys.readouterr().err
    assert cli.run(["convert", str(path), text, "--largest", "1.2"]) == 0
    assert cli.run(["validate", text]) == 3 and cli.run(["validate", text, "--largest", "2"]) == 0
    assert cli.run(["info", text]) == 3 and cli.run(["info", text, "--largest", "2"]) == 0
    for wrong in ("0", "-1", "nan", "inf", "x", "1e9"):
        assert cli.run(["info", text, "--largest", wrong]) == 2, wrong
    with limits.raised(2.0):
        assert files.read_signals(path)[0][0].transients[0].time_s == 100_000.0
    with pytest.raises(TooLargeError):
        files.read_signals(path)


@pytest.mark.parametrize("limit", [math.nan, math.inf, 86_401.0, 10**400])
def test_nan_exceeds_every_limit(limit):
    with pytest.raises(TooLargeError, match=r"x: it lasts .* s, allowed are 86,400 s"):
        limits.SECONDS.check(limit, "x", "it lasts")
    limits.SECONDS.check(86_400.0, "x", "it lasts")


def long_track(folder, count, rate_hz):
    """Write a track with contact at the first sample only, and a time base of ``count`` samples."""
    with track_of(folder, "vibration", "painted", BEAT) as track:
        header, runs = track.header, list(track.runs(0.0, 0.1))
    time = TimeBase(Fraction(rate_hz), Fraction(rate_hz), 0, 0, count - 1)
    values = {**vars(header), "time": time}
    fields = header.__dataclass_fields__
    path = folder / "long.hfxtrack"
    changed_header = type(header)(**{name: values[name] for name in fields})
    with TrackWriter(path, changed_header, full_precision=True) as writer:
        writer.append([replace(run, times_s=time.times_s(run.indices)) for run in runs])
    return path


@pytest.mark.parametrize("target", ["x.csv", "x.hjif"])
@pytest.mark.parametrize(("count", "rate_hz"), [(2**31 - 1, 24_000), (50_000_000, 1000)])
def test_a_small_track_of_many_samples_is_refused_at_once(tmp_path, count, rate_hz, target):
    path = long_track(tmp_path, count, rate_hz)
    device = None if target == "x.hjif" else "insoles"
    refused(lambda: convert(path, tmp_path / target, device=device), r"allowed are")
    assert not (tmp_path / target).exists()
    with TrackReader(path) as track:  # still readable
        assert track.header.time.sample_count == count and list(track.runs())


def test_a_long_track_is_converted(tmp_path):
    path = long_track(tmp_path, 60_000, 1000)
    convert(path, tmp_path / "x.raster.npz", device="phone_lra")
    assert len(npz_reader.read(tmp_path / "x.raster.npz").times_s) == 60_000


def archive(raster, folder, **arrays):
    """Return (claim in the header, file bytes) of a raster with some arrays replaced."""
    npz_raster.write(raster, folder / "a.raster.npz")
    content = io.BytesIO()
    with (
        zipfile.ZipFile(folder / "a.raster.npz") as old,
        zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as new,
    ):
        for name in old.namelist():
            key = name.removesuffix(".npy")
            new.writestr(name, arrays[key] if key in arrays else old.read(name))
    return content.getvalue()


def array(shape, count_bytes, kind="<f8"):
    head = f"{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}".encode()
    head += b" " * (-(len(head) + 11) % 64) + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(head)) + head + bytes(count_bytes)


@pytest.mark.parametrize("key", ["values", "times_s", "neutral"])
def test_an_archive_is_not_unpacked_before_its_shapes_fit(tmp_path, key):
    raster = raster_for(load_device("back_pad"), rows=20)
    wrong = archive(raster, tmp_path, **{key: array((7 << 20,), 56 << 20)})
    assert len(wrong) < 1 << 18
    refused(lambda: npz_reader.decode(wrong, "x"), "allowed is float64 of")
    lying = archive(raster, tmp_path, **{key: array((1 << 40, 16), 56 << 20)})
    refused(lambda: npz_reader.decode(lying, "x"), "an array of the wrong size")
    with limits.raised(0.05):
        refused(lambda: npz_reader.decode(wrong, "x"), "would take 5.* allowed are 53,687,091")


@pytest.mark.parametrize(
    "head",
    [b"{'descr': '<f8'", b")", b"{" * 3000, b"\x00", b"{'descr': [], 'shape': 3}", b"1" * 3000],
)
def test_heads_that_are_no_python_are_refused(tmp_path, head):
    raster = raster_for(load_device("back_pad"), rows=20)
    content = b"\x93NUMPY\x01\x00" + struct.pack("<H", len(head)) + head
    with pytest.raises(InputError, match=r"^x: not a raster archive"):
        npz_reader.decode(archive(raster, tmp_path, values=content), "x")


UNEVEN = {
    "descending": lambda t: t[::-1].copy(),
    "twice": lambda t: np.where(np.arange(len(t)) == 3, t[2], t),
    "a jump": lambda t: t + (np.arange(len(t)) > 8) * 0.5,
    "not finite": lambda t: np.where(np.arange(len(t)) == 3, np.nan, t),
    "endless": lambda t: np.where(np.arange(len(t)) == len(t) - 1, np.inf, t),
}


@pytest.mark.parametrize("kind", UNEVEN)
@pytest.mark.parametrize("suffix", [".raster.npz", ".csv"])
def test_times_that_are_no_clock_are_invalid_everywhere(tmp_path, kind, suffix):
    raster = raster_for(load_device("back_pad"), rows=20)
    object.__setattr__(raster, "times_s", UNEVEN[kind](raster.times_s))
    path = tmp_path / f"x{suffix}"
    (npz_raster if suffix == ".raster.npz" else csv_raster).write(raster, path)
    assert [finding.severity for finding in validate(path)[1]] == ["error"]
    for target in ("ahap", "csv", "npz", "wav", "tact", "hjif"):
        with pytest.raises(InputError, match="'times_s'"):
            convert(path, tmp_path / "y", to=target, device="back_pad")
    assert cli.run(["info", str(path)]) == 3


def test_references_and_overlap_have_a_limit():
    document = hjif(0)
    perception = document["perceptions"][0]
    frames = [{"relative_position": k, "amplitude_modulation": 0.5} for k in range(50)]
    perception["effect_library"] = [{"effect_type": "Basis", "id": 1, "keyframes": frames}]
    perception["effect_library"] += [
        {
            "effect_type": "Composite",
            "id": k + 2,
            "composition": [{"effect_type": "Reference", "id": k + 1}] * 40,
        }
        for k in range(3)
    ]
    band = perception["channels"][0]["bands"][0]
    band["effects"] = [{"effect_type": "Reference", "id": 4}]
    content = json.dumps(document).encode()
    with pytest.raises(TooLargeError, match="x: its references unfold to"):
        files.decoded(FORMATS["hjif"], content, "x")
    edges = Curve.of(np.linspace(0.0, 1.0, 50), np.full(50, 0.1))
    pieces = [Piece(0.0, 1.0 + k, edges, edges) for k in range(250)]  # 43 000 spans
    with limits.raised(40_000 / limits.OVERLAP.default):
        with pytest.raises(TooLargeError, match="sounds at the same time"):
            mixed("a", pieces)
    with limits.raised(45_000 / limits.OVERLAP.default):
        mixed("a", pieces)


@pytest.mark.parametrize(("width", "height"), [(1, 40_000), (40_000, 1), (30_000, 30_000)])
def test_a_picture_of_too_many_pixels_is_refused(tmp_path, width, height):
    head = struct.pack(">IIBBBBB", width, height, 16, 6, 0, 0, 0)
    parts = [(b"IHDR", head), (b"IDAT", zlib.compress(bytes(1 << 20))), (b"IEND", b"")]
    content = b"\x89PNG\r\n\x1a\n"
    for name, data in parts:
        total = zlib.crc32(name + data)
        content += struct.pack(">I", len(data)) + name + data + struct.pack(">I", total)
    path = tmp_path / "x.png"
    path.write_bytes(content)
    refused(lambda: png.read(path), "x.png: .*allowed are")


def test_strengths_every_20_ms_have_a_limit():
    day = signal([0.5, 0.5], rate_hz=1 / 80_000.0)
    with limits.raised(0.5), pytest.raises(TooLargeError, match="strengths every 20 ms"):
        tact.document([day], {}, next(iter(tact.LAYOUTS)), "x")


@pytest.mark.parametrize("seconds", [0.0, 1e-7, 1e-4, 0.5, 1000.25])
@pytest.mark.parametrize("target", ["ahap", "haptic", "he", "openxr", "hjif"])
def test_converted_files_are_valid_for_any_times(tmp_path, seconds, target):
    ramp = Signal("a", Curve.of([0.0, seconds], [0.5, 1.0]), Curve.of([0.0], [100.0]))
    hertz, tolerance = FrequencyRange(50.0, 200.0), 0.01
    (path,) = write_signals(FORMATS["haptic"], [ramp], hertz, tmp_path / "x", tolerance).files
    try:
        written = convert(path, tmp_path / "y", to=target)
    except InputError:
        assert [path.name for path in tmp_path.iterdir()] == [path.name]
        return
    for file in written.files:
        assert not [one for one in validate(file)[1] if one.severity == "error"]


@pytest.mark.parametrize("given", ["", "./", "sub/"])
def test_a_message_quotes_an_overlong_name(tmp_path, monkeypatch, given):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "sub").mkdir()
    (tmp_path / "x.ahap").write_text(json.dumps(ahap(1.0)))
    name = f"{given.removeprefix('./')}{'n' * 300}"
    with pytest.raises(OutputError, match=f"^{name}") as caught:
        convert(Path("x.ahap"), Path(f"{given}{'n' * 300}.he"))
    assert ".tmp" not in str(caught.value)


def continuous(count, levels):
    """Return consecutive events, each with a change of strength."""
    pattern = []
    for k in range(count):
        parameters = [{"ParameterID": "HapticIntensity", "ParameterValue": 0.5 + k % levels / 1e3}]
        event = {"Time": 2.0 * k, "EventType": "HapticContinuous", "EventDuration": 1.0}
        pattern.append({"Event": {**event, "EventParameters": parameters}})
        points = [{"Time": t, "ParameterValue": 0.5} for t in (0.0, 0.5)]
        curve = {"ParameterID": "HapticIntensityControl", "Time": 2.0 * k}
        pattern.append({"ParameterCurve": {**curve, "ParameterCurveControlPoints": points}})
    return json.dumps({"Version": 1.0, "Pattern": pattern}).encode()


def test_events_of_ahap_times_points_of_curves_have_a_bound():
    """Each level repeats the whole curve: a file of 2 MB once took 880 MiB."""
    with limits.raised(1e-3):  # 20,000 keyframes
        ((actual,), _) = ahap_format.decode(continuous(200, 5), "x")  # 5 x 600, not 200 x 600
        refused(lambda: ahap_format.decode(continuous(200, 200), "x"), "events and curves together")
    assert actual.amplitude.at(2.0 * 103 + 0.75) == pytest.approx(0.5 * 0.503)
    assert actual.amplitude.at(2.0 * 103 + 1.5) == 0.0


def test_a_writer_that_writes_nonsense_leaves_nothing(tmp_path, monkeypatch):
    """The final check runs after every writer."""
    path = tmp_path / "x.ahap"
    path.write_text(json.dumps(ahap(1.0)))

    def write_nonsense(signals, frequencies, stem, tolerance):
        output = stem.with_name(stem.name + ".haptic")
        output.write_text(json.dumps(haptic(-1.0)))
        return conversion.Written((output,))

    monkeypatch.setattr("hfx_blender.formats.device_files.haptic.write_signals", write_nonsense)
    with pytest.raises(InputError, match=r"y.haptic, which would not be valid: .*HAPTIC-"):
        convert(path, tmp_path / "y.haptic")
    assert [path.name for path in tmp_path.iterdir()] == ["x.ahap"]


def test_a_path_without_points_is_silent_and_reported(tmp_path):
    points = [{"x": x, "y": 0.5, "intensity": 0.8, "time": t} for x, t in ((0, 0), (1, 600))]
    dots = [{"index": k, "x": k % 4 / 3, "y": k // 4 / 4} for k in range(20)]

    def mode(*paths):
        feedback = [
            {"playbackType": "NONE", "movingPattern": "CONST_SPEED", "pointList": path}
            for path in paths
        ]
        dot_mode = {"dotConnected": False, "feedback": []}
        return {"mode": "PATH_MODE", "dotMode": dot_mode, "pathMode": {"feedback": feedback}}

    modes = {"VestFront": mode([], points, []), "VestBack": mode([])}
    effect = {"startTime": 0, "offsetTime": 1000, "modes": modes}
    layouts = {"VestFront": dots, "VestBack": dots}
    project = {
        "layout": {"type": "Tactot", "name": "Tactot", "layouts": layouts},
        "tracks": [{"effects": [effect]}, {"enable": False, "effects": []}],
    }
    document = {"project": project, "durationMillis": 1000, "intervalMillis": 20, "size": 20}
    path = tmp_path / "x.tact"
    path.write_text(json.dumps(document))
    actual, findings = validate(path)
    assert {finding.severity for finding in findings} == {"warning"} and actual.id == "tact"
    written = convert(path, tmp_path / "y.haptic")
    assert "3 paths without points, which are silent" in written.left_out
    assert "1 tracks that are switched off" in written.left_out
    signals, _ = files.read_signals(path)
    assert signals and all(item.name.startswith("VestFront") for item in signals)
    with pytest.raises(InputError, match="3 paths without points"):
        convert(path, tmp_path / "z.haptic", strict=True)


def test_sounds_and_unknown_parameters_of_ahap_are_reported(tmp_path):
    events = [
        {"Time": 0.0, "EventType": "AudioCustom", "EventParameters": []},
        {
            "Time": 0.0,
            "EventType": "HapticTransient",
            "EventParameters": [{"ParameterID": "AttackTime", "ParameterValue": 0.5}],
        },
    ]
    path = tmp_path / "x.ahap"
    path.write_text(json.dumps({"Version": 1.0, "Pattern": [{"Event": e} for e in events]}))
    left_out = convert(path, tmp_path / "y.haptic").left_out
    assert "1 events of the kind AudioCustom" in left_out
    assert "1 parameters AttackTime of events" in left_out


@pytest.mark.parametrize("channels", [[[]], [{}], [None], [1], ["x"]])
def test_an_index_with_channels_that_are_no_names_is_refused(tmp_path, channels):
    with track_of(tmp_path, "vibration", "painted", BEAT) as track:
        intact = track.path
    path = tmp_path / "y.hfxtrack"
    with zipfile.ZipFile(intact) as old, zipfile.ZipFile(path, "w") as new:
        for name in old.namelist():
            content = old.read(name)
            if name == "index.json":
                index = json.loads(content)
                index["streams"][0]["channels"] = channels
                content = json.dumps(index).encode()
            new.writestr(name, content)
    for command in ("validate", "info"):
        assert cli.run([command, str(path)]) == 3


def test_a_body_model_of_other_arrays_is_refused(tmp_path):
    path = tmp_path / "x.npz"
    meta = {"format": "PerceptualModel", "version": 1, "id": "x", "modality": "vibration"}
    meta |= {"bone_names": ["a"], "provenance": {}}
    for arrays in ({}, {"vertices": np.zeros((4, 3), np.float32)}, {"other": np.zeros(3)}):
        np.savez(path, meta=np.frombuffer(json.dumps(meta).encode(), np.uint8), **arrays)
        with pytest.raises(InputError, match=r"x.npz: not a readable body model"):
            load(PerceptualModel, path)
    names = model.ARRAYS
    with zipfile.ZipFile(path, "w") as archive:  # numpy returns a non-array member as bytes
        for name in names:
            archive.writestr(f"{name}.npy", b"no array")
        head = io.BytesIO()
        np.save(head, np.frombuffer(json.dumps(meta).encode(), np.uint8))
        archive.writestr("meta.npy", head.getvalue())
    with pytest.raises(InputError, match=r"x.npz: 'vertices' is not an array"):
        load(PerceptualModel, path)
    np.savez_compressed(path, meta=np.zeros(300 << 20, np.uint8))
    refused(lambda: load(PerceptualModel, path), "allowed are 268,435,456 bytes")


@pytest.mark.parametrize("name", [{}, [], 5])
def test_a_point_of_a_curve_does_not_name_its_parameter(name):
    """From fuzzing: the parameter is named by the curve, never by a point."""
    point = {"Time": 0.0, "ParameterValue": 2.0, "ParameterID": name}
    curve = {
        "ParameterID": "HapticIntensityControl",
        "Time": 0.0,
        "ParameterCurveControlPoints": [point],
    }
    document = {"Version": 1.0, "Pattern": [{"ParameterCurve": curve}]}
    actual = ahap_rules.validate(json.dumps(document).encode(), "a.ahap")
    assert any("HapticIntensityControl is 2" in entry.message for entry in actual)


@pytest.mark.parametrize("target", ["x.wav", "x.csv", "x.raster.npz"])
def test_a_few_bytes_do_not_become_a_day_of_values(tmp_path, target):
    """From a user report: within a day, and eight gigabytes of sound."""
    (tmp_path / "long.haptic").write_text(json.dumps(haptic(86_399.0)))
    with pytest.raises(TooLargeError, match=r"would become .* allowed are 268,435,456 bytes"):
        convert(tmp_path / "long.haptic", tmp_path / target, device="phone_lra")
    assert [path.name for path in tmp_path.iterdir()] == ["long.haptic"]


@pytest.mark.parametrize("name", ["a\ud800.png", "a\0.png"])
def test_a_name_that_no_file_can_have_is_refused(tmp_path, name):
    """From fuzzing: such a name is in the JSON of a haptic map."""
    with pytest.raises(InputError, match="cannot be read"):
        png.read(tmp_path / name)


def test_only_commands_with_an_option_name_the_option(tmp_path):
    with pytest.raises(TooLargeError) as refused_alone:
        limits.SECONDS.check(86_401.0, "a", "lasts")
    assert str(refused_alone.value) == "a: lasts 86,401 s, allowed are 86,400 s."
    with limits.raised(1.0), pytest.raises(TooLargeError, match=r"'--largest 1\.1' allows it"):
        limits.SECONDS.check(86_401.0, "a", "lasts")


def test_a_refusal_names_the_final_file(tmp_path):
    with pytest.raises(TooLargeError) as error, staging(tmp_path, "x") as stage:
        limits.SECONDS.check(86_401.0, str(stage / "a.hfxtrack"), "it lasts")
    assert str(error.value).startswith(f"{tmp_path / 'a.hfxtrack'}: it lasts")
