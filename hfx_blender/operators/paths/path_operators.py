# SPDX-License-Identifier: GPL-3.0-or-later
"""Operators of points on the skin: adding, paths, motion along the path, path library."""

from collections.abc import Sequence
from functools import cache
from pathlib import Path

import bpy
from bpy_extras.io_utils import ExportHelper

from ...authoring.effects import effects
from ...authoring.paths import path_file, paths, skin_picking
from ...blender.scene_info import animation_fps, metres_of
from ...engine.modality import MODALITY_ITEMS
from ...files import kinds
from .. import shared

_MIDDLE_OF_BACK = (0.0, 0.047, 1.25)
_ON_SKIN_M = 0.03

INTERPOLATIONS = (
    ("LINEAR", "Even", "The same speed along the whole path"),
    ("BEZIER", "Smooth", "Starts and stops softly; edit the handles in the Graph Editor"),
    ("SINE", "Sine", "Starts softly and stops softly"),
    ("QUAD", "Accelerating", "Faster and faster"),
    ("BOUNCE", "Bounce", "Bounces back from the end"),
    ("ELASTIC", "Elastic", "Overshoots and swings to rest"),
)


def active_spot(context: bpy.types.Context) -> bpy.types.Object | None:
    """Active effect if a point on the skin; otherwise None."""
    effect = shared.active_effect(context)
    return effect if effect is not None and effect.hfx.kind == "SPOT" else None


ON_SPOT = active_spot, "Select a point on the skin"


class PathOperator(shared.HfxOperator):
    """Base of operators that need a point on the skin with a position."""

    requires = (
        ON_SPOT,
        (
            lambda context: active_spot(context).get(paths.PATH),
            "Place the point, or draw its path first",
        ),
        shared.IS_EDITABLE,
    )


def add_spot_at(
    context: bpy.types.Context,
    modality: str,
    body: bpy.types.Object,
    place: Sequence[float],
    name: str | None = None,
) -> bpy.types.Object:
    """Add a point at a canonical place of a body's skin, metres; InputError if it is off the
    skin."""
    paths.skin().on_skin([place])  # refused before anything is made
    effect = paths.add_spot(context.scene, modality, body, name)
    paths.draw(effect, [place])
    paths.move_to_path(effect, context.evaluated_depsgraph_get())
    return effect


class HFX_OT_add_spot(shared.OnBodyOperator):
    """Add a point on the skin: a disc that can move along a path.

    Its position is the 3D cursor if near the body, otherwise the middle of the back
    """

    bl_label = "Point on the Skin"

    modality: bpy.props.EnumProperty(
        name="Modality",
        description="Sensation on the disc",
        items=[each for each in MODALITY_ITEMS if each[0] != "wind"],
    )
    place: bpy.props.FloatVectorProperty(
        name="Place",
        description="Where it is, metres in the rest space of the canonical body (the body faces "
        "-Y, its left is +X, its soles at Z = 0)",
        default=_MIDDLE_OF_BACK,
        precision=3,
    )
    name: bpy.props.StringProperty(name="Name")

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        if (
            not self.properties.is_property_set("place")
            and len(effects.bodies_of(context.scene)) == 1
        ):
            (body,) = effects.bodies_of(context.scene)
            picker = skin_picking.Picker(body, context.evaluated_depsgraph_get())
            reach = _ON_SKIN_M / metres_of(context.scene)
            nearest = picker.nearest(context.scene.cursor.location, reach)
            self.place = _MIDDLE_OF_BACK if nearest is None else nearest.tolist()
        return self.execute(context)

    def work(self, context: bpy.types.Context) -> str:
        body, name = shared.target_body(context), self.name or None
        effect = add_spot_at(context, self.modality, body, self.place, name)
        shared.select_only(context, effect)
        return f"'{effect.name}' does not move; draw a path to move it"


class HFX_OT_reverse_path(PathOperator):
    """Reverse the path; keyframes stay, so the point moves backwards"""

    bl_label = "Reverse Path"

    def work(self, context: bpy.types.Context) -> None:
        from ...authoring.paths import spot_placing

        spot_placing.remove_extension(active_spot(context))
        paths.reverse(active_spot(context))


class HFX_OT_mirror_path(PathOperator):
    """Mirror the path to the other side of the body"""

    bl_label = "Mirror Path"

    copy: bpy.props.BoolProperty(
        name="Copy",
        description="Leave this point as it is, and add another one on the other side that moves "
        "with the same keyframes and clips",
    )

    def work(self, context: bpy.types.Context) -> None:
        from ...authoring.paths import spot_placing

        effect = active_spot(context)
        spot_placing.remove_extension(effect)
        if self.copy:
            effect = effects.duplicate(effect)
            effect.name = f"{active_spot(context).name} Mirrored"
            shared.select_only(context, effect)
        paths.mirror(effect)


class HFX_OT_move_along_path(PathOperator):
    """Keyframe the position from the start to the end of the path, from the current frame"""

    bl_label = "Move along Path"

    seconds: bpy.props.FloatProperty(
        name="Duration", description="Seconds", default=1.0, min=0.01, soft_max=60.0
    )
    repeats: bpy.props.IntProperty(
        name="Times", description="Number of passes along the path", default=1, min=1, max=1000
    )
    to_and_fro: bpy.props.BoolProperty(name="To and Fro", description="Every second pass backwards")
    interpolation: bpy.props.EnumProperty(
        name="Speed", description="Change of speed along the path", items=INTERPOLATIONS
    )

    def work(self, context: bpy.types.Context) -> str:
        scene, effect = context.scene, active_spot(context)
        step = self.seconds * animation_fps(scene)
        start = float(scene.frame_current)
        keys: list[tuple[float, float]] = []
        for k in range(self.repeats):
            ends = (1.0, 0.0) if self.to_and_fro and k % 2 else (0.0, 1.0)
            first = start + k * step
            # The jump back to the start of a further pass lies between two keyframes that are 1 %
            # of a pass, and at most half a frame, apart.
            if keys and keys[-1][1] != ends[0]:
                keys[-1] = (keys[-1][0] - min(0.5, 0.01 * step), keys[-1][1])
            if not keys or keys[-1][1] != ends[0]:
                keys.append((first, ends[0]))
            keys.append((first + step, ends[1]))
        paths.set_motion(effect, keys, self.interpolation)
        return f"{paths.length_m(effect):.2f} m in {self.seconds:g} s"


@shared.kept_items
@cache
def _ready_paths() -> shared.EnumItems:
    return [
        (stem, recipe.name, recipe.description)
        for stem, path in path_file.library().items()
        for recipe in [path_file.load(path)]
    ]


def _apply(context: bpy.types.Context, recipe: path_file.PathRecipe) -> str:
    effect = active_spot(context)
    length = paths.apply(context.scene, effect, recipe, float(context.scene.frame_current))
    paths.move_to_path(effect, context.evaluated_depsgraph_get())
    return f"'{recipe.name}': {length:.2f} m"


class HFX_OT_path_from_library(shared.HfxOperator):
    """Give the point a ready path"""

    bl_label = "Path from Library"
    requires = (ON_SPOT, shared.IS_EDITABLE)

    name: bpy.props.EnumProperty(name="Path", items=_ready_paths)

    def work(self, context: bpy.types.Context) -> str:
        return _apply(context, path_file.load_library(self.name))


class HFX_OT_load_path(shared.ImportOperator, shared.OnBodyOperator):
    """Load a path file, with its motion if included, for the active point or a new point on the
    skin"""

    bl_label = "Load Path"

    filename_ext = kinds.PATH_SUFFIX
    filter_glob: bpy.props.StringProperty(default=f"*{kinds.PATH_SUFFIX}", options={"HIDDEN"})

    def work(self, context: bpy.types.Context) -> str:
        recipe = path_file.load(Path(self.filepath))
        if active_spot(context) is None:
            bpy.ops.hfx.add_spot()
        return _apply(context, recipe)


class HFX_OT_save_path(PathOperator, ExportHelper):
    """Save the path and the motion to a file"""

    bl_label = "Save Path"

    filename_ext = kinds.PATH_SUFFIX
    filter_glob: bpy.props.StringProperty(default=f"*{kinds.PATH_SUFFIX}", options={"HIDDEN"})
    name: bpy.props.StringProperty(name="Name", description="Empty: the name of the file")

    def work(self, context: bpy.types.Context) -> str:
        path = Path(self.filepath)
        title = self.name or path.stem.replace("_", " ").title()
        path_file.save(paths.recipe_of(context.scene, active_spot(context), title), path)
        return f"Saved the path to {path.name}"
