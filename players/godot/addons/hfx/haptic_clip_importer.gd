# SPDX-License-Identifier: MIT
@tool
extends EditorImportPlugin
## Imports .hfxclip files as [HapticClip].


func _get_importer_name() -> String:
	return "hfx.clip"


func _get_visible_name() -> String:
	return "Haptic Clip"


func _get_recognized_extensions() -> PackedStringArray:
	return ["hfxclip"]


func _get_save_extension() -> String:
	return "res"


func _get_resource_type() -> String:
	return "Resource"


func _get_preset_count() -> int:
	return 1


func _get_preset_name(_preset: int) -> String:
	return "Default"


func _get_import_options(_path: String, _preset: int) -> Array[Dictionary]:
	return []


func _get_import_order() -> int:
	return 0


func _get_priority() -> float:
	return 1.0


func _get_option_visibility(_path: String, _option: StringName, _options: Dictionary) -> bool:
	return true


func _import(
	source: String,
	save_path: String,
	_options: Dictionary,
	_variants: Array[String],
	_files: Array[String]
) -> Error:
	var clip := HapticClip.new()
	clip.bytes = FileAccess.get_file_as_bytes(source)
	var fault := clip.fault()
	if fault != "":
		push_error("%s: %s" % [source, fault])
		return ERR_FILE_CORRUPT
	return ResourceSaver.save(clip, "%s.%s" % [save_path, _get_save_extension()])
