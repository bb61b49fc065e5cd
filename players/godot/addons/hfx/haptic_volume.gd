# SPDX-License-Identifier: MIT
@tool
class_name HapticVolume
extends Node3D
## A volume of a clip in the game's world, felt by every [HapticBody] that it meets while it is
## visible. Scale it as the effect is scaled in Blender: its shape has unit size.
##
## Any number of nodes may have the same effect; all are felt.

const GROUP := &"haptic_volumes"

## Name of the effect in the clip.
@export var effect := "":
	set(value):
		effect = value
		update_configuration_warnings()
## 0 (off) to 1: multiplies the level that the effect has in the clip.
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


## Whether the node hangs on a bone, which moves when the skeletons have been updated.
var is_on_bone := false


func _enter_tree() -> void:
	add_to_group(GROUP)
	is_on_bone = false
	var node := get_parent()
	while node != null and not is_on_bone:
		is_on_bone = node is BoneAttachment3D
		node = node.get_parent()


func _validate_property(property: Dictionary) -> void:
	if property.name == "effect" and Engine.is_editor_hint():
		var names := _known_effects()
		if not names.is_empty():
			property.hint = PROPERTY_HINT_ENUM_SUGGESTION
			property.hint_string = ",".join(names)


func _get_configuration_warnings() -> PackedStringArray:
	if effect == "":
		return ["Choose an effect of the clip."]
	var names := _known_effects()
	if names.is_empty() or effect in names:
		return []
	return ["No clip has a volume '%s', but: %s." % [effect, ", ".join(names)]]


## Volume effects of the clips of this scene's bodies; without a body, of all clips of the project.
func _known_effects() -> PackedStringArray:
	var names := PackedStringArray()
	if not is_inside_tree():
		return names
	var clips: Array[HapticClip] = []
	for body: HapticBody in get_tree().root.find_children("*", "HapticBody", true, false):
		if body.get_effect_clip() != null:
			clips.append(body.get_effect_clip())
	if clips.is_empty() and Engine.has_singleton(&"EditorInterface"):
		var editor := Engine.get_singleton(&"EditorInterface")
		_add_clips(editor.get_resource_filesystem().get_filesystem(), clips)
	for clip in clips:
		for each in clip.get_effects():
			if not each.is_painted and not each.name in names:
				names.append(each.name)
	return names


func _add_clips(folder: Object, clips: Array[HapticClip]) -> void:
	if folder == null:
		return
	for k in folder.get_file_count():
		if folder.get_file_path(k).get_extension() == "hfxclip":
			var clip := load(folder.get_file_path(k)) as HapticClip
			if clip != null:
				clips.append(clip)
	for k in folder.get_subdir_count():
		_add_clips(folder.get_subdir(k), clips)
