# SPDX-License-Identifier: GPL-3.0-or-later
"""The single header, the C++ wrapper, and the component for Unreal against stubs of its types."""

from __future__ import annotations

import subprocess
from pathlib import Path

import numpy as np
import pytest
from core_library import ROOT, Body, Clip, Player, compiled
from small_clip import write_small_clip

from hfx_tools.formats import clip_rules
from release.single_header import single_header

CPP = ROOT / "players" / "cpp"
STUBS = Path(__file__).parent / "unreal_stubs"
CHECKED = ("-lstdc++", "-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-O0")

WRAPPER = """\
#include "hfx_player.hpp"
#include <cstdio>
#include <fstream>
#include <iterator>

static void print(const char *word, const std::vector<float> &values) {
  std::printf("%s", word);
  for (float value : values) std::printf(" %.6f", value);
  std::printf("\\n");
}

int main(int, char **arguments) {
  std::ifstream file(arguments[1], std::ios::binary);
  std::vector<unsigned char> bytes((std::istreambuf_iterator<char>(file)), {});
  hfx::Player player;
  hfx::Body body;
  {
    const hfx::Clip clip(std::move(bytes));
    std::printf("%d %d %s\\n", clip.error(), (int)clip.columns().size(), clip.devices()[0].id);
    player = hfx::Player(clip);
    body = hfx::Body(clip);
  }  // the clip's name ends, its bytes stay
  player.gain(0.5);
  std::printf("%d %d\\n", player.play("part"), hfx::Player(player).play("nothing"));
  print("advance", player.advance(0.25));
  player = hfx::Player(player.clip());
  player.play();
  print("advance", player.advance(0.25));
  print("silence", player.silence());
  const float rest[24] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
  const float matrix[12] = {2, 0, 0, 0, 0, 2, 0, 0, 0, 0, 2, 0};
  hfx::Body moved(std::move(body));
  const bool is_set = moved.set_bones(rest, 24), is_short = moved.set_bones(rest, 12);
  std::printf("%d %d %d\\n", is_set, is_short, moved.trigger(9, 1));
  for (unsigned k = 0; k < 4; k++) moved.trigger(k, 0.0);
  const std::uint32_t first = moved.add_volume(1), second = moved.add_volume(1);
  std::printf("%d\\n", moved.set_volume(second, matrix) && moved.trigger(second, 0.5));
  print("evaluate", moved.evaluate(0.02));
  std::printf("%.6f ", moved.level(second));
  std::printf("%d %d\\n", moved.remove_volume(first), moved.remove_volume(0));
  hfx::Stroke stroke(player.clip(), 1), lost(player.clip(), 2);
  std::printf("%d %d %s", lost.feel(0, 0, 0.01), stroke.feel(0.5, 0.1, 0.01),
              player.clip().surfaces()[1].name);
  stroke.feel(0.5, 0.9, 0.01);
  std::printf(" %.6f %.6f\\n", stroke.amplitude_m_s2(), stroke.frequency_hz());
  hfx::Body library(hfx::Clip(player.clip()), 0, hfx::Clip(player.clip()));
  const bool is_placed = library.place(4, 90.0, 50.0), is_volume = library.place(0, 90.0);
  library.set_bones(rest, 24);
  for (unsigned k = 0; k < 4; k++) library.trigger(k, 0.0);
  std::printf("%d %d %d", is_placed, is_volume, library.trigger(4, 1.0));
  print("", library.evaluate(0.02));
  library.place(4, 0.0);
  print("library", library.evaluate(0.02));
  player.pause(false);
  player.place(90.0, 0.0, 2.0);
  print("placed", player.advance(0.25));
  const hfx::Clip none;
  hfx::Body silent(none);
  std::printf("%s %d\\n", none.error_text(), hfx::Player(none).play("part"));
  print("none", silent.evaluate(1.0));
  return silent.trigger(0, 1.0) || silent.add_volume(0) != HFX_NONE || silent ? 1 : 0;
}
"""

UNREAL = """\
#include "HfxHapticComponent.cpp"
#include <fstream>
#include <iterator>

int main(int, char **arguments) {
  std::ifstream file(arguments[1], std::ios::binary);
  UHfxHapticComponent component;
  component.OnValuesChanged.bound = [](const TArray<float> &values) {
    for (int32 k = 0; k < values.Num(); k++) std::printf("%s%.6f", k ? " " : "", values[k]);
    std::printf("\\n");
  };
  const std::istreambuf_iterator<char> end;
  for (std::istreambuf_iterator<char> at(file); at != end; ++at) component.Clip.Add(uint8(*at));
  component.BeginPlay();
  const int32 there = component.FindColumn(TEXT("a"), TEXT("frequency_hz"));
  const int32 lost = component.FindColumn(TEXT("b"), TEXT("frequency_hz"));
  std::printf("%d %d %d\\n", component.Play(TEXT("part")), there, lost);
  component.SetLoop(false);
  for (int k = 0; k < 4; k++) component.TickComponent(0.25f, LEVELTICK_All, nullptr);
  component.Play(TEXT(""));
  component.TickComponent(0.25f, LEVELTICK_All, nullptr);
  component.EndPlay(EEndPlayReason::Destroyed);
  FString error;
  std::printf("%d", component.SetClip(TArray<uint8>(), error));
  std::printf(" %s %d\\n", utf8_of(*error).c_str(), component.Play(TEXT("part")));
  return 0;
}
"""


def output(program: Path, *arguments: Path) -> list[str]:
    done = subprocess.run([program, *arguments], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


def listed(values: np.ndarray) -> str:
    return " ".join(f"{item:.6f}" for item in values)


@pytest.mark.parametrize(("suffix", "standard"), [(".c", "c99"), (".cc", "c++17")])
def test_the_single_header_compiles_to_the_same_code(
    suffix: str, standard: str, tmp_path: Path
) -> None:
    single = single_header()
    assert "Permission is hereby granted" in single and '#include "' not in single
    source = "#define HFX_API extern\n"
    options = (f"-std={standard}", "-c")
    own = compiled(source + single, tmp_path / "one.o", *options, suffix=suffix)
    included = source + '#include "hfx_player.h"\n'
    of_core = compiled(included, tmp_path / "core.o", *options, suffix=suffix)
    assert own.read_bytes() == of_core.read_bytes()


def test_the_wrapper_gives_the_values_of_the_core(tmp_path: Path) -> None:
    clip = write_small_clip(tmp_path)
    options = ("-std=c++14", "-fno-exceptions", "-fno-rtti", f"-I{CPP}", *CHECKED)
    lines = output(compiled(WRAPPER, tmp_path / "wrapper", *options, suffix=".cc"), clip)
    content = Clip(clip.read_bytes())
    player, body = Player(content), Body(content)
    player.gain(0.5)
    player.replay("part")
    expected = ["0 2 d", "1 0", f"advance {listed(player.advance(0.25))}"]
    player.play()
    expected += [f"advance {listed(player.advance(0.25))}", f"silence {listed(player.silence())}"]
    body.set_bones(np.tile(np.eye(4)[:3], (2, 1, 1)))
    for effect in range(4):
        body.trigger(effect, 0.0)
    number = body.add_volume(1)
    body.set_volume(number, 2.0 * np.eye(4)[:3])
    body.trigger(number, 0.5)
    expected += ["1 0 0", "1", f"evaluate {listed(body.evaluate(0.02))}"]
    assert body.level(number) > 0.0
    expected += [f"{body.level(number):.6f} 1 0"]
    # From the first of six rows to the last: the highest intensity of all, up to 4 m/s^2.
    texels = clip_rules.read(clip.read_bytes(), clip.name)["TEXL"][20:]
    expected += [f"0 1 Edge {4.0 * (texels >> 8).max() / (2**24 - 1):.6f} 50.000000"]
    # The painted area leaves the body and comes back; one actuator has no other to take from.
    painted = Body(content, 0, Clip(clip.read_bytes()))
    painted.set_bones(np.tile(np.eye(4)[:3], (2, 1, 1)))
    for effect in range(4):
        painted.trigger(effect, 0.0)
    painted.trigger(4, 1.0)
    felt = painted.evaluate(0.02)
    assert felt[0] > 0.0
    expected += ["1 0 1 0.000000 61.000000", f"library {listed(felt)}"]
    player.play()
    player.advance(0.25)
    player.silence()
    player.pause(0)
    expected += [f"placed {listed(player.advance(0.25))}"]
    assert lines[: len(expected)] == expected
    assert lines[len(expected)].endswith(" 0") and lines[len(expected) + 1 :] == ["none"]


def test_the_component_for_unreal_plays_a_clip(tmp_path: Path) -> None:
    clip = write_small_clip(tmp_path)
    options = ("-std=c++17", f"-I{CPP}", f"-I{CPP / 'unreal'}", f"-I{STUBS}", *CHECKED)
    program = compiled(UNREAL, tmp_path / "unreal", *options, suffix=".cc")
    player = Player(Clip(clip.read_bytes()))
    player.replay("part")
    player.loop(0)
    expected = ["1 1 -1", *(listed(player.advance(0.25)) for _ in range(3)), "0.000000 61.000000"]
    player.replay()
    expected += [listed(player.advance(0.25)), "0.000000 61.000000"]
    lines = output(program, clip)
    assert lines[: len(expected)] == expected
    (refused,) = lines[len(expected) :]
    assert refused.startswith("0 ") and refused.endswith(" 0") and len(refused) > 10
