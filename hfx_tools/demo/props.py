# SPDX-License-Identifier: GPL-3.0-or-later
"""Props of the demo's garage without haptic effects: walls, a car, a fire, people, light."""

from __future__ import annotations

from math import pi, radians

import bpy

from hfx_blender.avatars.bodies import skin_mesh
from hfx_blender.blender.compat import new_fcurve, set_keys
from hfx_blender.engine.body.model import load_avatar

_Place = tuple[float, float]
_Vector = tuple[float, float, float]


def furnish(scene: bpy.types.Scene, fire: _Place, people: list[_Place]) -> None:
    """Add all visible props to the scene; locations on the ground are (x, y) in metres."""
    collection = bpy.data.collections.new("Garage")
    scene.collection.children.link(collection)
    grey = _material("Concrete", (0.32, 0.32, 0.33))
    wall = _material("Wall", (0.55, 0.53, 0.5))
    _box(collection, "Ground", (0.0, 0.0, -0.05), (18.0, 9.0, 0.1), grey)
    _box(collection, "Wall Back", (0.0, 4.5, 1.5), (18.0, 0.2, 3.0), wall)
    _box(collection, "Wall Left", (-9.0, 0.0, 1.5), (0.2, 9.0, 3.0), wall)
    _box(collection, "Vibrating Floor", (-5.0, -2.0, 0.003), (2.0, 2.0, 0.006), _steel())
    _add_car(collection, (2.2, 2.4))
    _add_fire(collection, fire)
    for person in people:
        _add_bystander(collection, (*person, 0.0), turn=-pi / 2)
    _add_light(scene, collection)
    _add_camera(scene, collection)


def add_lightning(frames: list[int]) -> None:
    """Add a lamp with flashes at the given frames."""
    lamp = bpy.data.lights.new("Lightning", "SUN")
    lamp.color = (0.75, 0.82, 1.0)
    flash = bpy.data.objects.new("Lightning", lamp)
    flash.rotation_euler = (radians(25), radians(-20), 0.0)
    bpy.data.collections["Garage"].objects.link(flash)
    action = bpy.data.actions.new("Lightning")
    lamp.animation_data_create().action = action
    keys = [(0.0, 0.0)]
    for strike in frames:
        keys += [(strike - 1, 0.0), (strike, 6.0), (strike + 8, 0.0)]
    set_keys(new_fcurve(lamp, action, "energy"), keys)


def _material(
    name: str, colour: _Vector, roughness: float = 0.8, glow: float = 0.0
) -> bpy.types.Material:
    material = bpy.data.materials.new(name)
    material.diffuse_color = (*colour, 1.0)
    if not material.node_tree:  # never None from Blender 5.0 on
        material.use_nodes = True
    shader = next(node for node in material.node_tree.nodes if node.type == "BSDF_PRINCIPLED")
    shader.inputs["Base Color"].default_value = (*colour, 1.0)
    shader.inputs["Roughness"].default_value = roughness
    if glow:
        shader.inputs["Emission Color"].default_value = (*colour, 1.0)
        shader.inputs["Emission Strength"].default_value = glow
    return material


def _steel() -> bpy.types.Material:
    return _material("Steel", (0.2, 0.22, 0.26), roughness=0.35)


def _object(
    collection: bpy.types.Collection, name: str, mesh: bpy.types.Mesh, material: bpy.types.Material
) -> bpy.types.Object:
    mesh.materials.append(material)
    obj = bpy.data.objects.new(name, mesh)
    collection.objects.link(obj)
    return obj


def _box(
    collection: bpy.types.Collection,
    name: str,
    centre: _Vector,
    size: _Vector,
    material: bpy.types.Material,
) -> bpy.types.Object:
    corners = [
        tuple((c - 0.5) * edge for c, edge in zip(corner, size, strict=True))
        for corner in ((i & 1, i >> 1 & 1, i >> 2 & 1) for i in range(8))
    ]
    faces = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(corners, [], faces)
    obj = _object(collection, name, mesh, material)
    obj.location = centre
    return obj


def _cone(
    collection: bpy.types.Collection,
    name: str,
    centre: _Vector,
    radii: tuple[float, float],
    height: float,
    material: bpy.types.Material,
) -> bpy.types.Object:
    """Add a cone frustum along Z; equal radii make a cylinder."""
    import bmesh

    mesh = bpy.data.meshes.new(name)
    shape = bmesh.new()
    bmesh.ops.create_cone(
        shape, cap_ends=True, segments=24, radius1=radii[0], radius2=radii[1], depth=height
    )
    shape.to_mesh(mesh)
    shape.free()
    obj = _object(collection, name, mesh, material)
    obj.location = centre
    return obj


def _add_car(collection: bpy.types.Collection, place: _Place) -> None:
    x, y = place
    paint = _material("Car Paint", (0.45, 0.06, 0.05), roughness=0.3)
    glass = _material("Glass", (0.05, 0.07, 0.09), roughness=0.1)
    rubber = _material("Rubber", (0.03, 0.03, 0.03))
    for obj, width in (
        (_box(collection, "Car Body", (x, y, 0.6), (4.2, 1.75, 0.6), paint), 0.12),
        (_box(collection, "Car Cabin", (x - 0.2, y, 1.15), (2.2, 1.55, 0.6), glass), 0.2),
    ):
        bevel = obj.modifiers.new("Bevel", "BEVEL")
        bevel.width, bevel.segments = width, 4
    for dx in (-1.35, 1.35):
        for dy in (-0.8, 0.8):
            centre = (x + dx, y + dy, 0.33)
            wheel = _cone(collection, "Wheel", centre, (0.33, 0.33), 0.22, rubber)
            wheel.rotation_euler = (pi / 2, 0.0, 0.0)


def _add_fire(collection: bpy.types.Collection, place: _Place) -> None:
    _cone(collection, "Barrel", (*place, 0.4), (0.28, 0.3), 0.8, _steel())
    colours = ((1.0, 0.25, 0.03), (1.0, 0.5, 0.08), (1.0, 0.8, 0.25))
    for k, colour in enumerate(colours):
        flame = _material(f"Flame {k + 1}", colour, glow=6.0)
        height = 0.55 - 0.13 * k
        _cone(
            collection,
            "Flame",
            (place[0] + 0.05 * k, place[1] - 0.04 * k, 0.8 + height / 2),
            (0.2 - 0.05 * k, 0.0),
            height,
            flame,
        )
    glow = bpy.data.lights.new("Fire", "POINT")
    glow.color, glow.energy = (1.0, 0.5, 0.2), 120.0
    lamp = bpy.data.objects.new("Fire", glow)
    lamp.location = (*place, 1.4)
    collection.objects.link(lamp)


def _add_light(scene: bpy.types.Scene, collection: bpy.types.Collection) -> None:
    for k, x in enumerate((-5.0, 0.0, 5.0)):
        light = bpy.data.lights.new(f"Ceiling {k + 1}", "AREA")
        light.energy, light.size = 220.0, 2.5
        lamp = bpy.data.objects.new(light.name, light)
        lamp.location = (x, -0.5, 3.6)
        collection.objects.link(lamp)
    world = bpy.data.worlds.new("Garage")
    if not world.node_tree:
        world.use_nodes = True
    background = next(node for node in world.node_tree.nodes if node.type == "BACKGROUND")
    background.inputs["Color"].default_value = (0.5, 0.55, 0.62, 1.0)
    background.inputs["Strength"].default_value = 0.45
    scene.world = world


def _add_camera(scene: bpy.types.Scene, collection: bpy.types.Collection) -> None:
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.data.lens = 26
    camera.location = (-1.0, -11.0, 4.6)
    camera.rotation_euler = (radians(70), 0.0, 0.0)
    collection.objects.link(camera)
    scene.camera = camera


def _add_bystander(
    collection: bpy.types.Collection, place: tuple[float, float, float], turn: float
) -> bpy.types.Object:
    """Add a still figure with the avatar's mesh, without haptics."""
    mesh = bpy.data.meshes.get("Bystander")
    if mesh is None:
        mesh = skin_mesh(load_avatar(), "Bystander")
    figure = bpy.data.objects.new("Bystander", mesh)
    figure.location = place
    figure.rotation_euler = (0.0, 0.0, turn)
    collection.objects.link(figure)
    return figure
