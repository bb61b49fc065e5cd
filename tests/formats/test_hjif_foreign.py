# SPDX-License-Identifier: GPL-3.0-or-later
"""HJIF of other tools: every document valid by the standard's schema is read, wavelets included."""

from __future__ import annotations

import json

import numpy as np
import pytest
from test_hjif import at, basis, sample

from hfx_blender.errors import InputError
from hfx_blender.files.strict_json import encoded
from hfx_blender.formats.hjif import (
    bands,
    hjif_reader,
    hjif_rules,
    wavelets,
)
from hfx_blender.formats.signals.curves import Curve
from hfx_blender.formats.sound.waveforms import Waveform, piece_of
from hfx_tools.commands.conversion import convert
from hfx_tools.formats import hjif_signals
from hfx_tools.formats.facts import facts_of

RATE = 8000
DIGITS = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/"


def channel_with(*bands, modality="Other", **members):
    """Return a document of one channel in the manner of MPEG's encoder."""
    channel = {"id": 0, "description": "c", "gain": 1.0, "mixing_coefficient": 1.0}
    channel |= {"body_part_mask": 0, "bands": list(bands), **members}
    perception = {"id": 0, "avatar_id": 0, "description": "", "perception_modality": modality}
    perception |= {"reference_devices": [], "effect_library": [], "channels": [channel]}
    document = {"version": "2023", "profile": "Main", "level": 1, "date": "2026-11-23 00:12:16"}
    document |= {"description": "", "timescale": 1000, "avatars": []}
    return {**document, "perceptions": [perception], "syncs": []}


def signal_of(document):
    (signal,), _ = hjif_signals.decode(encoded(document), "x")
    return signal


# --- wavelets: an encoder of our own, from the papers ---------------------------------------


def analysed(samples):
    """Return the 9/7 wavelet transform by lifting, after JPEG 2000 (ISO/IEC 15444-1, annex F)."""
    coefficients = np.array(samples, float)
    length = len(coefficients)
    while length >= 8:
        even, odd = coefficients[:length:2].copy(), coefficients[1:length:2].copy()
        for weight, is_odd in (
            (-1.586134342059924, True),
            (-0.052980118572961, False),
            (0.882911075530934, True),
            (0.443506852043971, False),
        ):
            if is_odd:
                odd += weight * (even + np.append(even[1:], even[-1]))
            else:
                even += weight * (odd + np.append(odd[0], odd[:-1]))
        gain = 1.230174104914001 / np.sqrt(2.0)
        # The standard negates the details.
        coefficients[: length // 2], coefficients[length // 2 : length] = even / gain, -odd * gain
        length //= 2
    return coefficients


class Code:
    """Writer of the arithmetic code: decisions of kinds become digits."""

    def __init__(self):
        self.digits, self.follow, self.low, self.high = [], 0, 0, 1024
        self.zeros, self.counts = [8] * 7, [16] * 7

    def put(self, decision, kind):
        width = self.high - self.low
        share = int(np.floor(1024 * self.zeros[kind] / self.counts[kind] + 0.5))
        split = self.low + min(max(width * share // 1024, 1), width - 1)
        self.low, self.high = (split, self.high) if decision else (self.low, split)
        self.zeros[kind] += not decision
        self.counts[kind] += 1
        while True:
            if self.high <= 512:
                self._digit(0)
                off = 0
            elif self.low >= 512:
                self._digit(1)
                off = 512
            elif self.low >= 256 and self.high <= 768:
                self.follow += 1
                off = 256
            else:
                return
            self.low, self.high = 2 * (self.low - off), 2 * (self.high - off)

    def _digit(self, digit):
        self.digits += [digit] + [1 - digit] * self.follow
        self.follow = 0

    def text(self):
        self.follow += 1
        self._digit(int(self.low >= 256))
        digits = "".join(map(str, self.digits))
        digits += "0" * (-len(digits) % 6)
        return "".join(DIGITS[int(digits[k : k + 6], 2)] for k in range(0, len(digits), 6))


def stream_of(values, planes, scale, is_large):
    """Return the SPIHT code (Said and Pearlman, 1996) of integers, a bit per list decision."""
    code, count = Code(), len(values)
    for number, length in ((planes, 4), (int(is_large), 1), (scale, 7)):
        for index in range(length):
            code.put(number >> index & 1, 0)

    def below(root, is_deep):  # largest of all descendants; deep: of those below the children
        level, most = [2 * root, 2 * root + 1], 0
        while level and level[0] < count:
            most = max(most, *(abs(values[k]) for k in level)) if not is_deep else most
            level, is_deep = [c for k in level for c in (2 * k, 2 * k + 1)], False
        return most

    points, trees, actual = list(range(8)), [(k, False) for k in range(4, 8)], []
    for plane in range(planes, -1, -1):
        step, old = 1 << plane, list(actual)

        def test(k, kind, step=step):
            code.put(is_new := abs(values[k]) >= step, kind)
            if is_new:
                code.put(values[k] >= 0, 1)
                actual.append(k)
            return is_new

        points = [k for k in points if not test(k, 2)]
        rest = []
        for root, is_deep in trees:
            is_split = below(root, is_deep) >= step
            code.put(is_split, 5 if is_deep else 3)
            if not is_split:
                rest.append((root, is_deep))
            elif is_deep:
                trees += [(2 * root, False), (2 * root + 1, False)]
            else:
                points += [k for k in (2 * root, 2 * root + 1) if not test(k, 4)]
                trees += [(root, True)] if 4 * root + 3 < count else []
        trees = rest
        for k in old:
            code.put(abs(values[k]) >> plane & 1, 6)
    return code.text()


@pytest.mark.parametrize(("count", "planes"), [(16, 3), (128, 9), (1024, 1)])
def test_a_coded_block_is_its_numbers(count, planes):
    random = np.random.default_rng(count)
    values = (random.laplace(0, 2**planes / 6, count)).astype(int)
    values = np.clip(values, 1 - 2 ** (planes + 1), 2 ** (planes + 1) - 1).tolist()
    decoded_block = wavelets.decoded_block(stream_of(values, planes, 96, False), count)
    assert decoded_block * 2**planes == pytest.approx(np.array(values) * 96 / 128)
    louder = wavelets.decoded_block(stream_of(values, planes, 20, True), count)
    assert louder * 2**planes == pytest.approx(np.array(values) * (1 + 20 / 8))


@pytest.mark.parametrize("count", [16, 512])
def test_the_transform_gives_the_samples_back(count):
    samples = np.random.default_rng(5).normal(size=count)
    assert wavelets.synthesized(analysed(samples)) == pytest.approx(samples, abs=1e-9)


def coded(samples, spacing_ticks=128):
    effects = []
    for k, block in enumerate(samples.reshape(-1, 1024)):
        values = np.rint(analysed(block) / (1 + 40 / 8) * 2**12).astype(int).tolist()
        stream = stream_of(values, 12, 40, True)
        effects.append(
            {"effect_type": "Basis", "position": k * spacing_ticks, "wavelet_stream": stream}
        )
    limits = {"lower_frequency_limit": 72, "upper_frequency_limit": RATE}
    return {"band_type": "WaveletWave", "block_length": 128, **limits, "effects": effects}


# A tone of 0.6 at 150 Hz for 2048 samples. The decoder of the reference encoder overlaps close
# blocks; here blocks play one after the other.
@pytest.mark.parametrize("spacing_ticks", [128, 16])
def test_a_wavelet_band_is_its_tone(spacing_ticks):
    tone = 0.6 * np.sin(2 * np.pi * 150 * np.arange(2048) / RATE)
    members = {"frequency_sampling": RATE, "sample_count": 2000}
    actual = signal_of(channel_with(coded(tone, spacing_ticks), **members))
    assert actual.left_out == ()
    times = np.linspace(0.03, 0.22, 50)
    assert actual.amplitude.at(times) == pytest.approx(0.6, abs=0.006)
    assert actual.frequency_hz.at(times) == pytest.approx(150.0, abs=1.5)
    assert actual.duration_s == pytest.approx(0.25)  # not the last block's end


def test_early_wavelets_are_keyframes_with_their_scale():
    tone = 0.6 * np.sin(2 * np.pi * 150 * np.arange(1024) / RATE)
    levels = [*(analysed(tone) / 6.0), 6.0, 12.0]
    frames = [{"relative_position": k, "amplitude_modulation": v} for k, v in enumerate(levels)]
    band = {**coded(tone), "curve_type": "Unknown", "block_length": 128.0}
    band["effects"] = [{"effect_type": "Basis", "position": 0, "keyframes": frames}]
    actual = signal_of(channel_with(band))
    assert actual.amplitude.at([0.04, 0.08]) == pytest.approx(0.6, abs=0.006)


@pytest.mark.parametrize("loudness", [0.2, 1.0, 1.7])
def test_quiet_and_loud_blocks_keep_their_ratio(loudness):
    """A block's maximum has 7 fraction bits below 1; above, 4 integer and 3 fraction bits.

    The bits are those of Spiht_Enc.h in MPEG's reference software: WAVMAXLENGTH 8, FRACTIONBITS_0
    7, INTEGERBITS_1 4, FRACTIONBITS_1 3.
    """
    blocks = analysed(0.5 * np.sin(2 * np.pi * 150 * np.arange(1024) / RATE)) * loudness
    largest = np.abs(blocks).max()
    bits, whole = (7, 0) if largest < 1.0 else (3, 1)
    scale = int(np.ceil((largest - whole) * 2**bits))
    values = np.rint(blocks / (whole + scale / 2**bits) * 2**12).astype(int).tolist()
    decoded_block = wavelets.decoded_block(stream_of(values, 12, scale, whole == 1), 1024)
    assert decoded_block == pytest.approx(blocks, abs=0.6 * 2**-12 * (whole + scale / 2**bits))


# The encoder cuts zeros off at a stream's end: nothing may be left of a silent block.
@pytest.mark.parametrize("stream", ["", "A", "AAAA"])
def test_a_silent_block_is_a_block_and_keeps_its_length(stream):
    tone = 0.6 * np.sin(2 * np.pi * 150 * np.arange(3072) / RATE)
    band = coded(tone, spacing_ticks=16)  # consecutive blocks, as the positions overlap
    band["effects"][1]["wavelet_stream"] = stream
    actual = signal_of(channel_with(band))
    assert actual.left_out == ()
    assert actual.duration_s == pytest.approx(3072 / RATE, abs=0.003)
    assert actual.amplitude.at([0.16, 0.2, 0.23]) == pytest.approx(0.0, abs=0.01)
    assert actual.amplitude.at([0.06, 0.3]) == pytest.approx(0.6, abs=0.006)


def test_a_band_that_is_silent_throughout_is_silence():
    band = coded(np.zeros(2048))
    for effect in band["effects"]:
        effect["wavelet_stream"] = ""
    actual = signal_of(channel_with(band))
    assert actual.left_out == ()
    assert actual.duration_s == pytest.approx(0.256, abs=0.003)
    assert not actual.amplitude.values.any()


def test_undecodable_wavelets_are_reported():
    band = coded(np.zeros(2048))
    band["effects"][1]["wavelet_stream"] = "not base64!"
    assert "1 effects have no readable wavelet stream" in str(
        signal_of(channel_with(band)).left_out
    )
    band["block_length"] = 100
    actual, _ = hjif_signals.decode(encoded(channel_with(band)), "x")
    assert "2 effects have no block length that is a power of two samples" in str(
        actual[0].left_out
    )


# --- waveforms and curves -------------------------------------------------------------------


def test_a_chirp_has_its_frequency_and_an_envelope_its_shape():
    times = np.arange(2 * RATE) / RATE
    chirp = np.sin(2 * np.pi * (50 * times + 62.5 * times**2))  # 50 to 300 Hz
    fade = 0.8 * np.minimum(times, 1.0)
    piece = piece_of(Waveform(0.5, RATE, fade * chirp), 0.5)
    at_s = np.array([0.3, 0.7, 1.2, 1.8])
    assert piece.frequency_hz.at(0.5 + at_s) == pytest.approx(50 + 125 * at_s, abs=1.0)
    assert piece.amplitude.at(0.5 + at_s) == pytest.approx(0.4 * np.minimum(at_s, 1.0), abs=0.004)


def test_the_curve_of_a_vibration_is_its_slow_part():
    # Extremes of a tone of 20 Hz: the cubic between neighbours is nearly the tone's sine.
    frames = [(k * 25, 0.5 * (-1) ** k, 0) for k in range(40)]
    effect = {**basis(*frames), "effect_type": "Basis"}
    band = {"band_type": "Curve", "curve_type": "Unknown", "effects": [effect]}
    band |= {"lower_frequency_limit": 0, "upper_frequency_limit": 72}
    actual = signal_of(channel_with(band))
    assert actual.amplitude.at([0.3, 0.5]) == pytest.approx(0.5, abs=0.03)
    assert actual.frequency_hz.at([0.3, 0.5]) == pytest.approx(20.0, abs=1.0)


@pytest.mark.parametrize(
    ("kind", "times", "expected"),
    [
        ("Linear", [0.25, 1.25], [0.25, 0.75]),
        ("Cubic", [0.25, 1.25], [0.15625, 0.84375]),  # 3 s^2 - 2 s^3 at a quarter
        ("Unknown", [0.25, 1.25], [0.15625, 0.84375]),
        ("Bezier", [0.5, 1.0], [0.375, 0.5]),  # 2 s (1 - s) at a quarter and a half
        ("BSpline", [0.5, 1.0], [0.375, 0.5]),  # of three points, the same arch
        ("Akima", [0.5, 1.5], [0.75, 0.75]),  # slopes 2, 0, -2: the parabola 2 t - t^2
    ],
)
def test_curves_between_keyframes(kind, times, expected):
    keyframes = Curve.of([0.0, 1.0, 2.0], [0.0, 1.0, 0.0])
    actual = bands.interpolated(keyframes, kind)
    assert actual.at(times) == pytest.approx(expected, abs=0.004)


# --- variants ---------------------------------------------------------------------------------


def early(document):
    """MPEG's published files from before the standard have this form."""
    document |= {"version": "1", "date": "Mon Oct  9 14:07:22 2023\n"}
    channel = document["perceptions"][0]["channels"][0]
    channel["mixing_weight"] = channel.pop("mixing_coefficient")
    for band in channel["bands"]:
        band |= {"block_length": 0.0, "curve_type": "Unknown"}


def older(document):
    """Return the document in the form of the standard's first drafts."""
    document["perceptions"][0]["tracks"] = document["perceptions"][0].pop("channels")
    for band in document["perceptions"][0]["tracks"][0]["bands"]:
        band |= {"band_type": "Wave", "encoding_modality": "Vectorial", "window_length": 0}


VARIANTS = {
    "date": lambda d: d.update(date="2024-04-22"),
    "keys": lambda d: d.update(x_tool=1, comment={"a": [1]}),
    "optional": lambda d: [d.pop(key) for key in ("syncs", "timescale")],
    "missing": lambda d: [d.pop(key) for key in ("avatars", "date", "profile", "level")],
    "whole": lambda d: d.update(timescale=1000.0),
    "avatar": lambda d: d["perceptions"][0].update(avatar_id=-1),
    "early": early,
    "older": older,
    "library": lambda d: d["perceptions"][0].pop("effect_library"),
}


@pytest.mark.parametrize("name", VARIANTS)
def test_variants_of_other_tools_play_the_same(name, tmp_path):
    wave = {**basis((0, 0.5, 100), (400, 0.5, 200)), "phase": 0.0, "base_signal": "Sine"}
    limits = {"lower_frequency_limit": 65, "upper_frequency_limit": 300}
    document = channel_with({"band_type": "VectorialWave", **limits, "effects": [wave]})
    plain = signal_of(document)
    VARIANTS[name](document)
    path = tmp_path / "x.hjif"
    path.write_bytes(encoded(document))
    actual = signal_of(document)
    assert actual.amplitude.at([0.1, 0.3]) == pytest.approx(plain.amplitude.at([0.1, 0.3]))
    assert actual.frequency_hz.at(0.2) == pytest.approx(150.0)
    assert any("HJIF-" in note for note in actual.notes)
    takes = name in ("date", "keys", "optional")
    assert facts_of(path)["valid"] == "yes" if takes else facts_of(path)["valid"].startswith("no, ")
    assert any("HJIF-" in note for note in convert(path, tmp_path / "x.haptic").notes)
    assert takes != any(finding.severity == "error" for finding in hjif_rules.findings(document))


def test_unknown_parts_of_a_composition_are_skipped():
    """The standard's schema allows any content of a composition."""
    parts = [basis((0, 0.5, 100), (400, 0.5, 200)), {"effect_type": True}, {"id": "x"}, 7]
    whole = {"effect_type": "Composite", "position": 100, "composition": parts}
    limits = {"lower_frequency_limit": 65, "upper_frequency_limit": 300}
    band = {"band_type": "VectorialWave", **limits, "effects": [whole]}
    actual = signal_of(channel_with(band))
    assert actual.amplitude.at([0.05, 0.3]) == pytest.approx([0.0, 0.5])
    assert any("HJIF-TYPE" in note for note in actual.notes)


def test_unknown_members_of_a_vector_are_only_unknown():
    document = channel_with()
    vector = {"X": 1, "Y": 1, "Z": 1, "size": []}
    document["perceptions"][0]["channels"][0]["actuator_resolution"] = vector
    assert "HJIF-UNKNOWN" in {finding.code for finding in hjif_rules.findings(document)}


def test_strict_findings_name_the_tool():
    document = channel_with()
    early(document)
    message_by_code = {finding.code: finding.message for finding in hjif_rules.findings(document)}
    assert "from before the standard" in message_by_code["HJIF-VERSION"]
    del document["version"]
    assert "MPEG's reference encoder" in str(
        hjif_rules.findings({**document, "version": "2023"})
    ) or ("from before the standard" in message_by_code["HJIF-MISSING"])


def test_ambiguous_documents_are_refused():
    for path, value in ((("perceptions",), "all"), (("perceptions", 0, "channels"), [])):
        document = sample()
        at(document, path[:-1])[path[-1]] = value
        with pytest.raises(InputError, match=r"HJIF-(TYPE|COUNT)"):
            hjif_reader.decode(json.dumps(document).encode(), "x")


def test_amplitudes_of_both_signs_pass_silence_in_between():
    wave = {**basis((0, 0.8, 100), (200, -0.8, 100)), "phase": 0.0, "base_signal": "Sine"}
    limits = {"lower_frequency_limit": 0, "upper_frequency_limit": 0}
    actual = signal_of(channel_with({"band_type": "VectorialWave", **limits, "effects": [wave]}))
    assert actual.amplitude.at([0.0, 0.05, 0.1]) == pytest.approx([0.8, 0.4, 0.0])


def test_a_band_may_be_sampled_faster_than_the_schema_has_limits(tmp_path):
    """The upper limit of a wavelet band is the sample rate of 16 kHz; the schema ends at 10 kHz."""
    tone = 0.6 * np.sin(2 * np.pi * 150 * np.arange(2048) / 16_000)
    band = {**coded(tone, spacing_ticks=64), "upper_frequency_limit": 16_000, "block_length": 64}
    document = channel_with(band)
    actual = signal_of(document)
    assert actual.left_out == () and any("HJIF-RANGE" in note for note in actual.notes)
    assert actual.frequency_hz.at([0.03, 0.09]) == pytest.approx(150.0, abs=2.0)
    assert actual.amplitude.at([0.03, 0.09]) == pytest.approx(0.6, abs=0.01)


def test_mixing_coefficients_are_named():
    wave = {**basis((0, 0.5, 100), (400, 0.5, 200)), "phase": 0.0, "base_signal": "Sine"}
    limits = {"lower_frequency_limit": 65, "upper_frequency_limit": 300}
    document = channel_with({"band_type": "VectorialWave", **limits, "effects": [wave]})
    assert not any("mixing" in note for note in signal_of(document).notes)
    document["perceptions"][0]["channels"][0]["mixing_coefficient"] = 0.5
    assert "mixing coefficients of its channels are not kept" in signal_of(document).notes
