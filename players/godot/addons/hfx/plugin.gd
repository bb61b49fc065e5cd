# SPDX-License-Identifier: MIT
@tool
extends EditorPlugin
## Makes .hfxclip files resources of the project, and draws haptic volumes.

const HapticClipImporter := preload("haptic_clip_importer.gd")
const HapticVolumeGizmo := preload("haptic_volume_gizmo.gd")
const HapticBodyInspector := preload("haptic_body_inspector.gd")

var _importer := HapticClipImporter.new()
var _gizmo := HapticVolumeGizmo.new()
var _inspector := HapticBodyInspector.new()


func _enter_tree() -> void:
	add_import_plugin(_importer)
	add_node_3d_gizmo_plugin(_gizmo)
	_inspector.undo_redo = get_undo_redo()
	add_inspector_plugin(_inspector)


func _exit_tree() -> void:
	remove_import_plugin(_importer)
	remove_node_3d_gizmo_plugin(_gizmo)
	remove_inspector_plugin(_inspector)
