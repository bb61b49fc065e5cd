# SPDX-License-Identifier: MIT
@tool
class_name HapticClip
extends Resource
## A clip made by HFX (.hfxclip): what each actuator of each device plays over time.
##
## Reads the recorded values of a clip, and names of its spatial part. Bytes are checked as a whole once, when they are
## imported or given to [method from_bytes].

const MAGIC := "48465843 4c49500a"
const VERSION := 1
const SIZES := {
	"TEXT": 1, "TIME": 24, "DEVC": 32, "ACTR": 88, "COLM": 40, "ROWS": 4, "VALU": 2, "CLIP": 24,
	"BODY": 24, "BONE": 72, "EFCT": 128, "SURF": 32, "HMAP": 32, "TEXL": 4,
}
const MODALITIES: PackedStringArray = ["vibration", "pressure", "temperature", "wind"]
const SHAPES: PackedStringArray = ["cuboid", "sphere", "cylinder", "capsule"]
const PLACES: PackedStringArray = ["vertices", "skin", "room"]
const SIDES: PackedStringArray = ["", "left", "right"]

## The file as it is.
@export_storage var bytes := PackedByteArray():
	set(value):
		bytes = value
		_is_read = false

var _is_read := false
var _parts := {}  # name: [offset, number of records]
var _rate_hz := 0.0
var _row_count := 0
var _devices: Array[Dictionary] = []
var _actuators: Array[Dictionary] = []
var _columns: Array[Dictionary] = []
var _named_clips := {}


## A clip of bytes of any origin; null, with an error in the log, if they are none.
static func from_bytes(file: PackedByteArray) -> HapticClip:
	var clip := HapticClip.new()
	clip.bytes = file
	var error := clip.fault()
	if error != "":
		push_error(error)
		return null
	return clip


## One sentence about what is wrong with the bytes; empty: nothing.
func fault() -> String:
	var error := _find_parts()
	_is_read = false
	if error != "":
		return error
	if not _is_checksum(bytes.slice(20), bytes.decode_u32(16)):
		return "The haptic clip is damaged: its checksum is not that of its content."
	return _read()


## Length, seconds.
func get_length() -> float:
	_read()
	return _row_count / _rate_hz if _rate_hz > 0.0 else 0.0


## Rows a second.
func get_rate_hz() -> float:
	_read()
	return _rate_hz


## Number of rows.
func get_row_count() -> int:
	_read()
	return _row_count


## For each device: id, name, body, first_actuator, actuators, dead_man_ms.
func get_devices() -> Array[Dictionary]:
	_read()
	return _devices


## Indices of the devices of a name: those with this id, or with it and _left or _right; "": all.
func find_devices(id: String) -> PackedInt32Array:
	var found := PackedInt32Array()
	for k in get_devices().size():
		if id == "" or _devices[k].id in [id, id + "_left", id + "_right"]:
			found.append(k)
	return found


## For each actuator: id, modality, first_column, columns, place (vertices, skin or room), side, parts,
## bone, human_bone, centre_m (on the canonical body, in the clip's space), update_interval_ms, slew_per_s, maximum_on_s, rest_s.
func get_actuators() -> Array[Dictionary]:
	_read()
	return _actuators


## For each column: parameter, unit, lowest, highest, neutral.
func get_columns() -> Array[Dictionary]:
	_read()
	return _columns


## Named clips of the scene: name to [start in seconds, end in seconds, whether it loops].
func get_named_clips() -> Dictionary:
	_read()
	return _named_clips


## Bodies of the spatial part: name, and bones, each with name, human (of VRM 1.0), mixamo, unreal
## and parent (-1: none).
func get_bodies() -> Array[Dictionary]:
	_read()
	var found: Array[Dictionary] = []
	for k in _count("BODY"):
		var at := _at("BODY", k)
		var first := bytes.decode_u32(at + 4)
		var bones: Array[Dictionary] = []
		for number in range(first, mini(first + bytes.decode_u32(at + 8), _count("BONE"))):
			bones.append(_bone(_at("BONE", number), number - first))
		found.append({"name": _text(at), "bones": bones})
	return found


## Volumes and painted areas: name, is_painted, modality, shape, half_segment, level, and transform,
## that of a [HapticVolume] where the scene has it first.
func get_effects() -> Array[Dictionary]:
	_read()
	var found: Array[Dictionary] = []
	for k in _count("EFCT"):
		var at := _at("EFCT", k)
		found.append({
			"name": _text(at),
			"is_painted": bytes.decode_u32(at + 4) == 1,
			"modality": MODALITIES[mini(bytes.decode_u32(at + 8), 3)],
			"shape": SHAPES[mini(bytes.decode_u32(at + 20), 3)],
			"half_segment": bytes.decode_float(at + 24),
			"level": bytes.decode_float(at + 36),
			"transform": _transform(at + 76),
		})
	return found


## Haptic surfaces: name, columns, rows, width_mm, height_mm, tiles, lowest_m_s2, highest_m_s2,
## lowest_hz, highest_hz, uv_width_mm and uv_height_mm (of 1 in texture coordinates; 0: none), and texels, the byte of the first texel.
func get_surfaces() -> Array[Dictionary]:
	_read()
	var found: Array[Dictionary] = []
	for k in _count("SURF"):
		var at := _at("SURF", k)
		var number := bytes.decode_u32(at + 4)
		var map := _at("HMAP", number)
		if number >= _count("HMAP") or not _is_map(map):
			return []
		found.append({
			"name": _text(at),
			"columns": bytes.decode_u32(map),
			"rows": bytes.decode_u32(map + 4),
			"width_mm": bytes.decode_float(map + 8),
			"height_mm": bytes.decode_float(map + 12),
			"tiles": bytes.decode_u32(map + 16) == 1,
			"lowest_m_s2": bytes.decode_float(at + 8),
			"highest_m_s2": bytes.decode_float(at + 12),
			"lowest_hz": bytes.decode_float(at + 16),
			"highest_hz": bytes.decode_float(at + 20),
			"uv_width_mm": bytes.decode_float(at + 24),
			"uv_height_mm": bytes.decode_float(at + 28),
			"texels": _at("TEXL", bytes.decode_u32(map + 20)),
		})
	return found


## What each column gives while nothing is felt.
func get_neutral_values() -> PackedFloat32Array:
	_read()
	var values := PackedFloat32Array()
	for column in _columns:
		values.append(column.neutral)
	return values


func _read() -> String:
	if _is_read:
		return ""
	_rate_hz = 0.0
	_row_count = 0
	_devices.clear()
	_actuators.clear()
	_columns.clear()
	_named_clips.clear()
	var error := _find_parts()
	if error == "":
		error = _read_tables()
	_is_read = error == ""
	if not _is_read:
		_actuators.clear()
		_columns.clear()
		_rate_hz = 0.0
	return error


func _find_parts() -> String:
	_parts = {}
	if bytes.size() < 24 or bytes.slice(0, 8).hex_encode() != MAGIC.replace(" ", ""):
		return "This is no haptic clip."
	if bytes.decode_u32(8) > VERSION:
		return (
			"The haptic clip is of version %d; this add-on reads up to %d."
			% [bytes.decode_u32(8), VERSION]
		)
	var sections := bytes.decode_u32(20)
	if bytes.decode_u32(12) != bytes.size() or sections > 64 or 24 + 16 * sections > bytes.size():
		return "The haptic clip is cut off."
	for k in sections:
		var at := 24 + 16 * k
		var name := bytes.slice(at, at + 4).get_string_from_ascii()
		if not SIZES.has(name):
			continue
		var offset := bytes.decode_u32(at + 4)
		var size := bytes.decode_u32(at + 8)
		if offset % 8 != 0 or offset + size > bytes.size() or size % int(SIZES[name]) != 0:
			return "Section %s of the haptic clip does not fit into it." % name
		if _parts.has(name):
			return "Section %s stands twice in the haptic clip." % name
		_parts[name] = [offset, size / int(SIZES[name])]
	for name in ["TEXT", "TIME"]:
		if not _parts.has(name):
			return "The haptic clip has no section %s." % name
	return ""


func _read_tables() -> String:
	if _count("TIME") != 1:
		return "The haptic clip says nothing, or too much, about its time."
	var time := _at("TIME", 0)
	_rate_hz = bytes.decode_double(time)
	_row_count = bytes.decode_u32(time + 16)
	if not (_rate_hz > 0.0 and _rate_hz <= 1e6):
		return "The haptic clip has %s rows a second." % _rate_hz
	for k in _count("COLM"):
		_columns.append(_column(_at("COLM", k)))
	for k in _count("ACTR"):
		var actuator := _actuator(_at("ACTR", k))
		if not _fits(actuator):
			return "Actuator %d of the haptic clip breaks a rule of the format." % k
		_actuators.append(actuator)
	for k in _count("DEVC"):
		_devices.append(_device(_at("DEVC", k)))
	for k in _count("CLIP"):
		var at := _at("CLIP", k)
		var is_looping := bytes.decode_u32(at + 4) == 1
		_named_clips[_text(at)] = [
			bytes.decode_double(at + 8), bytes.decode_double(at + 16), is_looping
		]
	return ""


func _column(at: int) -> Dictionary:
	return {
		"parameter": _text(at),
		"unit": _text(at + 4),
		"neutral_number": bytes.decode_u32(at + 12),
		"lowest": bytes.decode_double(at + 16),
		"highest": bytes.decode_double(at + 24),
		"neutral": bytes.decode_double(at + 32),
	}


func _actuator(at: int) -> Dictionary:
	var rows := bytes.decode_u32(at + 16)
	var count := bytes.decode_u32(at + 20)
	var first := _part_offset("ROWS") + 4 * rows
	return {
		"id": _text(at),
		"modality": MODALITIES[mini(bytes.decode_u32(at + 4), 3)],
		"first_column": bytes.decode_u32(at + 8),
		"columns": bytes.decode_u32(at + 12),
		"rows": bytes.slice(first, first + 4 * count).to_int32_array(),
		"row_count": count,
		"values": _part_offset("VALU") + 2 * bytes.decode_u32(at + 24),
		"last_value": bytes.decode_u32(at + 24) + count * bytes.decode_u32(at + 12),
		"place": PLACES[mini(bytes.decode_u32(at + 28), 2)],
		"side": SIDES[mini(bytes.decode_u32(at + 32), 2)],
		"parts": _text(at + 36),
		"bone": _text(at + 40),
		"human_bone": _text(at + 44),
		"centre_m": Vector3(
			bytes.decode_float(at + 48), bytes.decode_float(at + 52), bytes.decode_float(at + 56)
		),
		"update_interval_ms": bytes.decode_float(at + 68),
		"slew_per_s": bytes.decode_float(at + 72),
		"maximum_on_s": bytes.decode_float(at + 76),
		"rest_s": bytes.decode_float(at + 80),
	}


func _fits(actuator: Dictionary) -> bool:
	var rows: PackedInt32Array = actuator.rows
	return (
		actuator.columns >= 1
		and actuator.columns <= 8
		and actuator.first_column + actuator.columns <= _columns.size()
		and actuator.row_count >= 1
		and rows.size() == actuator.row_count
		and rows[0] == 0
		and actuator.last_value <= _count("VALU")
	)


func _is_map(at: int) -> bool:
	var texels := bytes.decode_u32(at) * bytes.decode_u32(at + 4)
	return texels > 0 and bytes.decode_u32(at + 20) + texels <= _count("TEXL")


func _device(at: int) -> Dictionary:
	return {
		"id": _text(at),
		"name": _text(at + 4),
		"body": _text(at + 8),
		"first_actuator": bytes.decode_u32(at + 12),
		"actuators": bytes.decode_u32(at + 16),
		"dead_man_ms": bytes.decode_u32(at + 28),
	}


func _bone(at: int, number: int) -> Dictionary:
	var parent := bytes.decode_u32(at + 16)
	return {
		"name": _text(at),
		"human": _text(at + 4),
		"mixamo": _text(at + 8),
		"unreal": _text(at + 12),
		"parent": parent if parent < number else -1,
	}


func _count(name: String) -> int:
	return _parts[name][1] if _parts.has(name) else 0


func _part_offset(name: String) -> int:
	return _parts[name][0] if _parts.has(name) else 0


func _at(name: String, index: int) -> int:
	return _part_offset(name) + int(SIZES[name]) * index


func _text(at: int) -> String:
	var begin := _part_offset("TEXT") + bytes.decode_u32(at)
	var end := bytes.find(0, begin) if begin < bytes.size() else -1
	return bytes.slice(begin, end).get_string_from_utf8() if end >= begin else ""


## A matrix of the clip's space as a transform of Godot's: (x, z, -y).
func _transform(at: int) -> Transform3D:
	var n: Array[float] = []
	for k in 12:
		n.append(bytes.decode_float(at + 4 * k))
	var turned := Transform3D(Basis(Vector3.RIGHT, Vector3.FORWARD, Vector3.UP), Vector3.ZERO)
	var placed := Transform3D(
		Vector3(n[0], n[4], n[8]), Vector3(n[1], n[5], n[9]), Vector3(n[2], n[6], n[10]),
		Vector3(n[3], n[7], n[11])
	)
	return turned * placed * turned.affine_inverse()


## Whether data has a CRC-32. GDScript would take 0.3 s a megabyte: here Godot's gzip checks it, given
## the data as gzip's stored blocks, which begin with their length and its complement.
static func _is_checksum(data: PackedByteArray, checksum: int) -> bool:
	var packed := "1f8b08000000000000ff".hex_decode()
	for first in range(0, data.size(), 0xFFFF):
		var size := mini(data.size() - first, 0xFFFF)
		var head := PackedByteArray([int(first + size == data.size()), 0, 0, 0, 0])
		head.encode_u16(1, size)
		head.encode_u16(3, size ^ 0xFFFF)
		packed.append_array(head)
		packed.append_array(data.slice(first, first + size))
	var end := PackedByteArray()
	end.resize(8)
	end.encode_u32(0, checksum)
	end.encode_u32(4, data.size())
	packed.append_array(end)
	return packed.decompress(data.size(), FileAccess.COMPRESSION_GZIP).size() == data.size()
