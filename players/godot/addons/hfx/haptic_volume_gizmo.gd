# SPDX-License-Identifier: MIT
@tool
extends EditorNode3DGizmoPlugin
## Draws the shape of a [HapticVolume] as lines.

const _STEPS := 32


func _init() -> void:
	create_material("lines", Color(1.0, 0.55, 0.35))


func _get_gizmo_name() -> String:
	return "HapticVolume"


func _has_gizmo(node: Node3D) -> bool:
	return node is HapticVolume


func _redraw(gizmo: EditorNode3DGizmo) -> void:
	gizmo.clear()
	var volume: HapticVolume = gizmo.get_node_3d()
	gizmo.add_lines(lines_of(volume.shape, volume.half_segment), get_material("lines", gizmo))


## Ends of lines, two by two, in the node's own space.
static func lines_of(shape: String, half_segment: float) -> PackedVector3Array:
	var lines := PackedVector3Array()
	match shape:
		"cuboid":
			var box := AABB(-Vector3.ONE, 2.0 * Vector3.ONE)
			for k in 8:
				for bit in [1, 2, 4]:
					if not k & bit:
						lines.append_array([box.get_endpoint(k), box.get_endpoint(k | bit)])
		"sphere":
			for axis in 3:
				_circle(lines, axis, Vector3.ZERO)
		"cylinder", "capsule":
			var half := 1.0 if shape == "cylinder" else half_segment
			for end in [-half, half]:
				_circle(lines, 1, Vector3(0.0, end, 0.0))
				if shape == "capsule":
					_circle(lines, 0, Vector3(0.0, end, 0.0))
					_circle(lines, 2, Vector3(0.0, end, 0.0))
			for side in [Vector3.LEFT, Vector3.RIGHT, Vector3.FORWARD, Vector3.BACK]:
				lines.append_array([side - Vector3(0, half, 0), side + Vector3(0, half, 0)])
	return lines


static func _circle(lines: PackedVector3Array, axis: int, centre: Vector3) -> void:
	for k in _STEPS:
		for angle in [TAU * k / _STEPS, TAU * (k + 1) / _STEPS]:
			var place := Vector3.ZERO
			place[(axis + 1) % 3] = cos(angle)
			place[(axis + 2) % 3] = sin(angle)
			lines.append(centre + place)
