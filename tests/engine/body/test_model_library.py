# SPDX-License-Identifier: GPL-3.0-or-later
"""User models, found by id next to the shipped models."""

from __future__ import annotations

import json
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path

import body_sets
import numpy as np
import pytest
from coarse_models import at_level

from hfx_blender.engine.body import levels_and_cells, model, model_library
from hfx_blender.engine.retargeting.retarget import fitted_to_variant
from hfx_blender.errors import InputError
from hfx_blender.files import resources

SUFFIX = "+0badcafe"


@pytest.fixture(scope="module")
def variant(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return body_sets.scaled_variant(tmp_path_factory.mktemp("sets") / "tall", SUFFIX, 1.1)


@pytest.fixture
def own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Set the user's model folder to an empty folder."""
    monkeypatch.setenv("HFX_BODY_MODELS", str(tmp_path / "own"))
    for cached in (model.load_model, model.load_avatar):
        cached.cache_clear()
    yield tmp_path / "own"
    for cached in (model.load_model, model.load_avatar):
        cached.cache_clear()


def edit(path: Path, change: object) -> None:
    index = json.loads(path.read_text())
    change(index)  # type: ignore[operator]
    path.write_text(json.dumps(index))


def test_without_a_folder_only_shipped_models_are_found(own: Path) -> None:
    assert not own.exists()
    assert model_library.installed() == ([], [])
    ids = [entry.id for entry in model_library.shipped() if entry.kind == "model"]
    assert ids == list(model.manifest()["models"])


@pytest.mark.parametrize(
    ("platform", "variables", "folder"),
    (
        ("linux", {"XDG_DATA_HOME": "/data"}, "/data/hfx/body_models"),
        ("linux", {"HOME": "/home/eve"}, "/home/eve/.local/share/hfx/body_models"),
        ("darwin", {"HOME": "/u/eve"}, "/u/eve/Library/Application Support/hfx/body_models"),
        ("win32", {"APPDATA": "/roaming"}, "/roaming/hfx/body_models"),
        ("win32", {"HFX_BODY_MODELS": "/elsewhere"}, "/elsewhere"),
    ),
)
def test_the_place_is_the_platforms_or_the_one_that_is_named(
    platform: str, variables: dict[str, str], folder: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("XDG_DATA_HOME", "APPDATA", "HFX_BODY_MODELS"):
        monkeypatch.delenv(name, raising=False)
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(sys, "platform", platform)
    assert resources.user_body_models() == Path(folder)


def test_an_installed_variant_is_found_by_its_ids(own: Path, variant: Path) -> None:
    shutil.copytree(variant, own / "tall")
    user_model, shipped = (model.load_model(f"hfx-pressure-1{end}") for end in (SUFFIX, ""))
    assert user_model.vertices == pytest.approx(1.1 * shipped.vertices)
    avatar = model.load_avatar(f"hfx-avatar-1{SUFFIX}")
    assert avatar.vertices == pytest.approx(1.1 * model.load_avatar().vertices)
    entries, faults = model_library.installed()
    assert [entry.id for entry in entries] == [
        f"hfx-{name}-1{SUFFIX}" for name in ("avatar", "pressure", "vibration", "temperature")
    ]
    assert not faults
    assert [person.id for person in model_library.people()] == [avatar.id]


def test_a_variant_has_the_levels_and_cells_of_its_ids(own: Path, variant: Path) -> None:
    shutil.copytree(variant, own / "tall")
    coarse, coarse_of = at_level(model.load_model(f"hfx-pressure-1{SUFFIX}"), 1)
    shipped, same = at_level(model.load_model("hfx-pressure-1"), 1)
    assert np.array_equal(coarse_of, same)
    assert coarse.vertices == pytest.approx(1.1 * shipped.vertices)
    fine, owner = levels_and_cells.cell_of_skin(model.load_model(f"hfx-temperature-1{SUFFIX}"))
    assert fine == f"hfx-pressure-1{SUFFIX}"
    assert len(owner) == len(model.load_model(fine))


def test_canonical_ids_stand_on_the_variant_exactly(own: Path, variant: Path) -> None:
    shutil.copytree(variant, own / "tall")
    fitted = fitted_to_variant(model.load_avatar(f"hfx-avatar-1{SUFFIX}"))
    assert [model_id.model_id for model_id in fitted] == list(model.manifest()["models"])
    for name in fitted:
        shipped = model.load_model(name.model_id)
        assert name.model_hash == shipped.content_hash
        assert name.of(shipped).vertices == pytest.approx(1.1 * shipped.vertices)


def test_the_same_set_twice_is_no_fault(own: Path, variant: Path) -> None:
    shutil.copytree(variant, own / "one")
    shutil.copytree(variant, own / "two")
    entries, faults = model_library.installed()
    assert len(entries) == 4 and not faults
    assert model.load_model(f"hfx-vibration-1{SUFFIX}").id == f"hfx-vibration-1{SUFFIX}"


def test_models_with_equal_ids_are_reported_with_paths(own: Path, variant: Path) -> None:
    shutil.copytree(variant, own / "one")
    body_sets.scaled_variant(own / "two", SUFFIX, 0.9)
    with pytest.raises(InputError, match="exists twice with different content") as caught:
        model.load_model(f"hfx-pressure-1{SUFFIX}")
    for name in ("one", "two"):
        assert str(own / name / "pressure.npz") in str(caught.value)
    assert model.load_model("hfx-pressure-1").id == "hfx-pressure-1"


def test_nothing_takes_the_place_of_a_shipped_model(own: Path, variant: Path) -> None:
    shutil.copytree(variant, own / "sly")
    before = model.load_model("hfx-pressure-1").content_hash
    edit(
        own / "sly" / "manifest.json",
        lambda index: index["models"].update(
            {"hfx-pressure-1": index["models"].pop(f"hfx-pressure-1{SUFFIX}")}
        ),
    )
    model.load_model.cache_clear()
    assert model.load_model("hfx-pressure-1").content_hash == before
    assert any("the shipped model" in fault for fault in model_library.installed()[1])


def test_a_file_unlike_its_manifest_is_refused(own: Path, variant: Path) -> None:
    shutil.copytree(variant, own / "tall")
    shutil.copy(own / "tall" / "temperature.npz", own / "tall" / "pressure.npz")
    with pytest.raises(InputError, match=r"pressure\.npz: holds 'hfx-temperature-1\+0badcafe'"):
        model.load_model(f"hfx-pressure-1{SUFFIX}")


@pytest.mark.parametrize(
    ("content", "message"),
    (
        ("{", "cannot be read as an index"),
        ("[]", "cannot be read as an index"),
        ('{"models": {"x": {"file": "a.npz"}}}', "cannot be read as an index"),
        ('{"models": {"x": {"file": "../a.npz", "hash": "0"}}}', "'x' names no file of this"),
        ('{"models": {"x": {"file": "/a.npz", "hash": "0"}}}', "'x' names no file of this"),
    ),
)
def test_a_broken_set_is_reported_and_hides_no_other(
    own: Path, variant: Path, content: str, message: str
) -> None:
    shutil.copytree(variant, own / "tall")
    (own / "broken").mkdir()
    (own / "broken" / "manifest.json").write_text(content)
    entries, faults = model_library.installed()
    assert len(entries) == 4
    assert len(faults) == 1 and message in faults[0] and "broken" in faults[0]
    assert model.load_model(f"hfx-pressure-1{SUFFIX}") is not None
    with pytest.raises(
        InputError, match=r"'nobody' is unknown\. Available: hfx-pressure-1"
    ) as caught:
        model.load_model("nobody")
    assert message in str(caught.value) and f"hfx-pressure-1{SUFFIX}" in str(caught.value)


def test_a_variant_of_another_edition_is_refused(own: Path, variant: Path) -> None:
    shutil.copytree(variant, own / "tall")
    actual = model.load_model(f"hfx-temperature-1{SUFFIX}")
    actual.provenance["canonical"]["hash"] = "0" * 64
    with pytest.raises(InputError, match="a variant of another edition of 'hfx-temperature-1'"):
        fitted_to_variant(model.load_avatar(f"hfx-avatar-1{SUFFIX}"))
