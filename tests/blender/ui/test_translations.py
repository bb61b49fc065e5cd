# SPDX-License-Identifier: GPL-3.0-or-later
"""German and Japanese translations: complete, with equal placeholders, and used by Blender."""

from __future__ import annotations

import ast
import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from hfx_blender.blender import translation
from hfx_blender.blender.translation import Translation
from hfx_blender.operators.shared import draw_wrapped
from release import messages

GERMAN = {
    "{0} added": "{0} hinzugefügt",
    "Wrote {0}{1}": "{0}{1} geschrieben",
    " and {0} more": " und {0} weitere",
    "'{0}' {1}: not felt": "'{0}' {1}: nicht gefühlt",
    "belongs to a body that was deleted": "gehört zu einem gelöschten Körper",
    "{0} has no clip '{1}'.": "'{1}' ist kein Clip von {0}.",
    "'{0}' is painted nowhere": "'{0}' ist leer",
    "Vibration": "Schwingung",
    "not felt": "nicht gefühlt",
}


@pytest.fixture
def german() -> Translation:
    return Translation(GERMAN)


@pytest.mark.parametrize("language", messages.LANGUAGES)
def test_every_text_is_translated(scene: Any, language: str) -> None:
    lines = messages.faults(language, messages.messages())
    assert lines == [], "see: python -m release.messages"


def test_a_missing_a_superfluous_and_a_faulty_translation_are_found(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "translations").mkdir()
    (tmp_path / "translations" / "de.json").write_text('{"{0} of {1}": "{0} von", "Old": "Alt"}')
    monkeypatch.setattr(messages, "PACKAGE", tmp_path)
    lines = messages.faults("de", {"{0} of {1}": "a.py", "New": "b.py"})
    assert lines == [
        "missing: 'New' (b.py)",
        "superfluous: 'Old'",
        "other placeholders: '{0} of {1}' -> '{0} von'",
    ]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("Pad added", "Pad hinzugefügt"),
        ("Wrote a.csv, b.csv and 3 more", "a.csv, b.csv und 3 weitere geschrieben"),
        ("'A' belongs to a body that was deleted: not felt", None),
        ("Effect has no clip 'x'.", "'x' ist kein Clip von Effect."),
        ("Vibration added", "Vibration hinzugefügt"),  # a name of the user stays
        ("'Pad added' is painted nowhere", "'Pad added' ist leer"),
        ("Pad added. Not felt", "Pad hinzugefügt. Nicht gefühlt"),
        ("of another program", "of another program"),
    ],
)
def test_texts_with_values_are_translated(
    german: Translation, text: str, expected: str | None
) -> None:
    whole = "'A' gehört zu einem gelöschten Körper: nicht gefühlt"
    assert german.of(text) == (expected or whole)


@pytest.mark.parametrize(
    ("text", "german", "japanese"),
    [
        ("Above threshold: 10 to 43 dB", "Über der Schwelle: 10 bis 43 dB", "10から43 dB"),
        ("8 actuators for temperature: soles", "8 Aktor(en) für Temperatur: Fußsohlen", "温度"),
        ("Effects pasted: 1", "Eingefügte Effekte: 1", "1個のエフェクト"),
    ],
)
def test_values_of_panels_and_reports_are_translated(text: str, german: str, japanese: str) -> None:
    files = {name: messages.PACKAGE / "translations" / f"{name}.json" for name in ("de", "ja")}
    of = {name: Translation(json.loads(path.read_bytes())).of for name, path in files.items()}
    assert of["de"](text) == german
    assert japanese in of["ja"](text)


def test_texts_stay_in_english_without_a_language(scene: Any) -> None:
    assert translation.translated("Choose a file.") == "Choose a file."


def test_blender_translates_labels(scene: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    registered: dict[str, Any] = {}
    contexts = SimpleNamespace(default="*", operator_default="Operator")
    fake = SimpleNamespace(contexts=contexts, register=lambda name, texts: registered.update(texts))
    monkeypatch.setattr(translation, "bpy", SimpleNamespace(app=SimpleNamespace(translations=fake)))
    translation.register()
    assert set(registered) == set(messages.LANGUAGES)
    for context in ("*", "Operator"):
        assert registered["de"][context, "Add Device"] == "Neues Gerät"
        assert registered["ja"][context, "Add Device"] == "デバイスを追加"


def test_lines_hold_half_as_many_japanese_letters_and_empty_texts_none() -> None:
    lines: list[str] = []
    layout = SimpleNamespace(label=lambda text, **_options: lines.append(text))
    draw_wrapped(layout, "あ" * 30, 20)
    assert [len(line) for line in lines] == [10, 10, 10]
    draw_wrapped(layout, "", 20)
    assert len(lines) == 3


def _formatted(node: ast.expr) -> bool:
    """Test for a text with values and words."""
    text = messages.template(node)
    return text is not None and "{" in text and any(map(str.isalpha, text))


def test_reports_and_texts_with_values_pass_the_translation() -> None:
    places = []
    for folder in ("ui", "operators", "properties"):
        for path in sorted((messages.PACKAGE / folder).rglob("*.py")):
            for call in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if not isinstance(call, ast.Call):
                    continue
                shown = [k.value for k in call.keywords if k.arg in ("text", "title")]
                if getattr(call.func, "attr", "") == "report" and len(call.args) == 2:
                    text = call.args[1]
                    is_done = isinstance(text, ast.Call) and "translated" in ast.unparse(text.func)
                    places += [] if is_done else [f"{path.name}:{call.lineno}"]
                places += [f"{path.name}:{call.lineno}" for text in shown if _formatted(text)]
    assert places == [], "these texts do not pass blender.translation.translated"
