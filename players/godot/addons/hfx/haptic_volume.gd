# SPDX-License-Identifier: MIT
@tool
class_name HapticVolume
extends Node3D
## A volume of a clip in the game's world, felt by every [HapticBody] that it meets while it is
## visible. Scale it as the effect is scaled in Blender: its shape has unit size.

const GROUP := &"haptic_volumes"

## Name of the effect in the clip.
@export var effect := ""
## 0 (off) to 1.
@export_range(0.0, 1.0) var level := 1.0
## What the editor draws; what is felt follows the clip.
@export_enum("cuboid", "sphere", "cylinder", "capsule") var shape := "sphere":
	set(value):
		shape = value
		update_gizmos()
## Half of a capsule's segment.
@export var half_segment := 1.0:
	set(value):
		half_segment = value
		update_gizmos()


func _enter_tree() -> void:
	add_to_group(GROUP)
