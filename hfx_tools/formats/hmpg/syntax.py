# SPDX-License-Identifier: GPL-3.0-or-later
"""Numbers of the choices, types of units and packets, and field widths that both directions use."""

from __future__ import annotations

from types import MappingProxyType
from typing import Final

UNIT_BYTES: Final = 9  # type 6, sync 2, layer 4, duration 24, length 32, reserved 4 bits
PACKET_BYTES: Final = 3  # type 6, length 17, reserved 1 bits
LONGEST_PACKET: Final = (1 << 17) - 1  # bytes after the head

INITIALIZATION, TEMPORAL, SPATIAL, SILENT = range(4)
"""Types of units."""

TIMING, EXPERIENCE, PERCEPTION, CHANNEL, BAND, DATA, LIBRARY = range(7)
CRC32, CRC16, GLOBAL_CRC16, GLOBAL_CRC32, INITIAL_TIMING = range(7, 12)
"""Types of packets."""

CHECKSUMS: Final = (CRC32, CRC16, GLOBAL_CRC16, GLOBAL_CRC32)
NO_DEVICE: Final = 255
MOST_HZ, MOST, FULL_TURN = 10_000.0, 10_000.0, 6.28318
"""Upper ends of frequencies, of all further numbers, and of phases in radians."""

MODALITIES: Final = (
    *("Other", "Pressure", "Acceleration", "Velocity", "Position", "Temperature", "Vibrotactile"),
    *("Water", "Wind", "Force", "Vibrotactile Texture", "Stiffness", "Friction", "Electrotactile"),
)
OVER_SPACE: Final = ("Vibrotactile Texture", "Stiffness", "Friction")
"""Modalities over space instead of time. The reference software writes their effects in another
form than it reads them, so neither is done here."""

BAND_TYPES: Final = ("Transient", "Curve", "VectorialWave", "WaveletWave")
CURVE_TYPES: Final = ("Unknown", "Cubic", "Linear", "Akima", "Bezier", "BSpline")
EFFECT_TYPES: Final = ("Basis", "Reference", "Composite")
BASE_SIGNALS: Final = ("Sine", "Square", "Triangle", "SawToothUp", "SawToothDown")
AVATAR_TYPES: Final = ("Custom", "Vibration", "Pressure", "Temperature")

DEVICE_NUMBERS: Final = MappingProxyType(
    {
        **dict.fromkeys(
            ("maximum_frequency", "minimum_frequency", "resonance_frequency"), (0.0, MOST_HZ)
        ),
        **dict.fromkeys(
            (
                *("maximum_amplitude", "impedance", "maximum_voltage", "maximum_current"),
                *("maximum_displacement", "weight", "size"),
            ),
            (0.0, MOST),
        ),
        "custom": (-MOST, MOST),
    }
)
"""Range of each optional number of a reference device, in the order of the mask's bits. The last
bit of the mask is the actuator type, of 4 bits."""

_BODY_PARTS: Final = {
    0: "Unknown,All",
    10: "Upper,Lower,Right,Left,Front,Back",
    20: "Arm,Head,Chest,Waist,Leg",
    30: "Upper-arm,Forearm,Hand,Crane,Neck,Thigh,Calf,Foot",
    40: "Palm,Finger,Sole,Toe",
    50: "Thumb,Index,Middle,Ring,Pinky,Hallux,Index-Toe,Middle-Toe,Ring-Toe,Pinky-Toe",
    60: "First Phalanx,Second Phalanx,Third Phalanx",
    254: "Minus,Plus",
}
BODY_PARTS: Final = {
    first + k: name
    for first, names in _BODY_PARTS.items()
    for k, name in enumerate(names.split(","))
}
"""Body part targets by number."""

_KEYWORDS: Final = (
    "UX/Undefined Click DoubleClick Success Error Alarm Confirmatioon Wrong Ring Message",
    "Avatar/Undefined Jumping Fall Crawl Swim Collision Grab Touch Swip Footstep",
    "SpecialFX/Undefined Washout Noise",
    "WeaponCombat/Undefined Blade Hit HandThrown ElasticPropulsion Pneumatic Handgun Rifle "
    "Shotgun Gun Machinegun Taser ElectricShock Mine Missile Grenade Blast",
    "Ambient/Undefined Wind Heat Cold Rain Waterfall WaterDrop ElectricBuzz Ignition Cracks "
    "Earthquack Sparks Thunderbolt",
    "Texture/Undefined Rock Gravel Sand Wood Metal Plastic",
    "Vehicle/Undefined Engine Doors Brake MechanicalContraption Drift RoadFriction RoadBump Tires "
    "AirFriction",
    "Music/Undefined HardMaterial BouncyMaterial Pucking Bowing Striking BrassInstrument "
    "WoodWindInstrument",
)
KEYWORDS: Final = {
    256 * k + number: f"{group}/{word}"
    for k, (group, words) in enumerate(line.split("/") for line in _KEYWORDS)
    for number, word in enumerate(words.split())
}
"""Semantic keywords by number: a group in 4 bits, a word of the group in 8 bits."""
KEYWORD_NUMBERS: Final = {keyword: number for number, keyword in KEYWORDS.items()}


def block_ticks(code: int, upper_hz: int, timescale: int) -> int:
    """Length of wavelet blocks in ticks. The reference software has two forms of the field: ticks,
    which are 16 or more, and the power of two above 16 samples, which is less."""
    if code >= 16:
        return code
    return round((16 << code) * timescale / upper_hz) if upper_hz else 0


def block_code(ticks: int, upper_hz: int, timescale: int) -> int:
    """Code of a length of wavelet blocks: the ticks if the field holds them, else the power of two
    above 16 samples."""
    samples = round(ticks * upper_hz / timescale)
    return ticks if 16 <= ticks <= 255 else max(samples.bit_length() - 5, 0)
