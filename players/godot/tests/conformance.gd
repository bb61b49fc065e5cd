# SPDX-License-Identifier: MIT
extends SceneTree
## Plays players/conformance and compares each value: godot --headless --script tests/conformance.gd
## -- FOLDER. Ends with 1 if one is wrong.

const STEP := 1.0 / 65535.0
const ROUNDING := 1e-6  # of numbers in 32 bits

var _wrong := 0
var _compared := 0


func _init() -> void:
	var folder: String = OS.get_cmdline_user_args()[0]
	var count := 0
	for name in DirAccess.get_files_at(folder):
		if name.ends_with(".hfxclip"):
			count += 1
			_play(folder.path_join(name))
	print("%d clips, %d values compared, %d wrong" % [count, _compared, _wrong])
	quit(1 if _wrong > 0 or count == 0 or _compared == 0 else 0)


func _play(path: String) -> void:
	var clip := HapticClip.from_bytes(FileAccess.get_file_as_bytes(path))
	if clip == null:
		return _say("%s cannot be read" % path)
	var player := HapticPlayer.new()
	player.clip = clip
	var factors := {}
	var number := 0
	for line in FileAccess.get_file_as_string(path.replace(".hfxclip", ".txt")).split("\n", false):
		number += 1
		var sides := line.split(" = ")
		var call := sides[0].split(" ", true, 1)
		var argument := call[1] if call.size() > 1 else ""
		match call[0]:
			"columns":
				if clip.get_columns().size() != int(argument):
					_say("%s has %d columns" % [path, clip.get_columns().size()])
			"play", "named":
				player.gain = 1.0
				player.loop = false
				for parameter in factors:
					player.set_parameter(parameter, 1.0)
				factors.clear()
				player.play(argument)
			"gain":
				player.gain = float(argument)
			"parameter":
				var words := argument.split(" ")
				factors[words[0]] = float(words[1])
				player.set_parameter(words[0], factors[words[0]])
			"loop":
				player.loop = argument == "1"
			"pause":
				player.pause(argument == "1")
			"stop":
				player.stop()
			"seek":
				player.seek(float(argument))
			"advance", "silence":
				if call[0] == "silence":
					player.pause()
				var place := "%s, line %d" % [path.get_file(), number]
				_compare(player, player.advance(float(argument)), sides[1], factors, place)
			_:
				_say("%s, line %d: unknown call '%s'" % [path, number, call[0]])
	player.free()


func _compare(
	player: HapticPlayer, found: PackedFloat32Array, line: String, factors: Dictionary, place: String
) -> void:
	var expected := line.split(" ")
	var columns := player.clip.get_columns()
	var strengths := player.clip.get_actuators().map(func(each): return each.first_column)
	for k in columns.size():
		var column := columns[k]
		var scale: float = factors.get(column.parameter, 1.0) * (player.gain if k in strengths else 1.0)
		var slack: float = (
			STEP * (column.highest - column.lowest) * maxf(scale, 1.0)
			+ ROUNDING * maxf(absf(column.lowest), absf(column.highest))
		)
		_compared += 1
		if k >= found.size() or absf(found[k] - float(expected[k])) > slack:
			_say("%s, column %d: %s instead of %s" % [place, k, found[k], expected[k]])


func _say(text: String) -> void:
	_wrong += 1
	if _wrong < 20:
		print(text)
