# SPDX-License-Identifier: MIT
@tool
extends EditorPlugin
## Makes .hfxclip files resources of the project.

const HapticClipImporter := preload("haptic_clip_importer.gd")

var _importer := HapticClipImporter.new()


func _enter_tree() -> void:
	add_import_plugin(_importer)


func _exit_tree() -> void:
	remove_import_plugin(_importer)
