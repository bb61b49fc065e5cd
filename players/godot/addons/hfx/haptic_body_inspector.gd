# SPDX-License-Identifier: MIT
@tool
extends EditorInspectorPlugin
## Button of a [HapticBody] that creates a [HapticVolume] for each volume of its clip.

const HapticVolumes := preload("haptic_volumes.gd")

var undo_redo: EditorUndoRedoManager


func _can_handle(object: Object) -> bool:
	return object is HapticBody


func _parse_begin(object: Object) -> void:
	var button := Button.new()
	button.text = "Create Volumes from the Clip"
	button.tooltip_text = (
		"Adds a HapticVolume for each volume of the clip that the scene has none of: shape, size and"
		+ " place as in Blender, below the node or bone of the same name."
	)
	button.disabled = object.get_effect_clip() == null
	button.pressed.connect(_create.bind(object))
	add_custom_control(button)


func _create(body: HapticBody) -> void:
	var scene := EditorInterface.get_edited_scene_root()
	var created := HapticVolumes.create(body.get_effect_clip(), scene, body.skeleton)
	if created.is_empty():
		print("HFX: the scene has all volumes of the clip.")
		return
	undo_redo.create_action("Create Volumes from the Clip", UndoRedo.MERGE_DISABLE, scene)
	for each: Dictionary in created:
		for instance: Node in each.instances:
			if not scene.is_editable_instance(instance):
				undo_redo.add_do_method(scene, "set_editable_instance", instance, true)
				undo_redo.add_undo_method(scene, "set_editable_instance", instance, false)
		undo_redo.add_do_method(each.parent, "add_child", each.node, true)
		for node: Node in each.owned:
			undo_redo.add_do_property(node, "owner", scene)
		undo_redo.add_do_reference(each.node)
		undo_redo.add_undo_method(each.parent, "remove_child", each.node)
	undo_redo.commit_action()
	print("HFX: %d volumes created." % created.size())
