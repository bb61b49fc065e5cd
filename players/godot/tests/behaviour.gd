# SPDX-License-Identifier: MIT
extends SceneTree
## Plays players/conformance/behaviour: godot --headless --script tests/behaviour.gd -- FOLDER. Ends
## with 1 if a result differs.

var _wrong := 0
var _checks := 0
var _player: HapticPlayer


func _init() -> void:
	_run.call_deferred(OS.get_cmdline_user_args()[0])


func _run(folder: String) -> void:
	_play(folder.path_join("behaviour"), folder.path_join("behaviour.hfxclip"))
	_play(folder.path_join("placed"), folder.path_join("ring.hfxclip"))
	_feel(folder)
	print("%d results, %d wrong" % [_checks, _wrong])
	quit(1 if _wrong > 0 or _checks < 90 else 0)


func _play(script: String, path: String) -> void:
	var clip := HapticClip.from_bytes(FileAccess.get_file_as_bytes(path))
	var number := 0
	for line in FileAccess.get_file_as_string(script + ".txt").split("\n"):
		number += 1
		if line == "" or line.begins_with("#"):
			continue
		var call := line.get_slice("=", 0).strip_edges()
		var expected := line.get_slice("=", 1).strip_edges() if "=" in line else ""
		var argument := call.get_slice(" ", 1) if not call.begins_with("play ") else call.substr(5)
		if not " " in call:
			argument = ""
		match call.get_slice(" ", 0):
			"open":
				_player = HapticPlayer.new()
				_player.clip = clip
				root.add_child(_player)
				_player.set_process(false)
			"play":
				_check(number, str(int(_player.play(argument))), expected)
			"parameter":
				var is_known := _player.set_parameter(argument, float(call.get_slice(" ", 2)))
				_check(number, str(int(is_known)), "1" if expected == "" else expected)
			"playing":
				_check(number, str(int(_player.is_playing())), expected)
			"position":
				var is_there := absf(_player.get_playback_position() - float(expected)) < 1e-6
				_check(number, expected if is_there else str(_player.get_playback_position()), expected)
			"devices":
				_check(number, " ".join(Array(clip.find_devices(argument)).map(str)), expected)
			"loop":
				_player.loop = argument == "1"
			"gain":
				_player.gain = _number(argument)
			"pause":
				_player.pause(argument == "1")
			"stop":
				_player.stop()
			"seek":
				_player.seek(float(argument))
			"place":
				_player.turn_degrees = _number(argument)
				_player.raise_m = _number(call.get_slice(" ", 2))
				_player.stretch = _number(call.get_slice(" ", 3))
			"advance":
				_compare(number, _player.advance(float(argument)), expected)
			_:
				_check(number, "an unknown call", "")


## Effects of a library on the body of another clip.
func _feel(folder: String) -> void:
	if not ClassDB.class_exists(&"HapticBodyCore"):
		_check(0, "the compiled core is not there", "")
		return
	var avatar := HapticClip.from_bytes(FileAccess.get_file_as_bytes(folder.path_join("avatar.hfxclip")))
	var library := HapticClip.from_bytes(FileAccess.get_file_as_bytes(folder.path_join("library.hfxclip")))
	var names := library.get_effects().map(func(each: Dictionary) -> String: return each.name)
	var core: RefCounted = ClassDB.instantiate(&"HapticBodyCore")
	var number := 0
	for line in FileAccess.get_file_as_string(folder.path_join("effects.txt")).split("\n"):
		number += 1
		if line == "" or line.begins_with("#"):
			continue
		var words := line.get_slice("=", 0).strip_edges().split(" ")
		var expected := line.get_slice("=", 1).strip_edges() if "=" in line else ""
		if words[0] == "open":
			_check(number, str(core.open(avatar.bytes, 0, library.bytes)), "0")
			core.set_bones(HapticBody.rows_of(Transform3D.IDENTITY))
			continue
		if words[0] == "evaluate":
			_compare(number, core.evaluate(float(words[1])), expected)
			continue
		var effect := names.find(words[1])
		var numbers: Array = Array(words.slice(2)).map(func(word: String) -> float: return float(word))
		var error := 0
		match words[0]:
			"trigger":
				error = core.trigger(effect, numbers[0])
			"place":
				error = core.place(effect, numbers[0], numbers[1], numbers[2])
			"volume", "add":
				if words[0] == "add":
					effect = core.add_volume(effect)
				var at := Transform3D(
					Basis.from_scale(numbers[3] * Vector3.ONE), Vector3(numbers[0], numbers[1], numbers[2])
				)
				error = core.set_volume(effect, HapticBody.rows_of(at)) + core.trigger(effect, 1.0)
		_check(number, str(int(error == 0)), expected)


func _compare(number: int, found: PackedFloat32Array, expected: String) -> void:
	var values := expected.split(" ")
	var is_right := found.size() == values.size()
	for k in mini(found.size(), values.size()):
		is_right = is_right and absf(found[k] - float(values[k])) < 0.003
	_check(number, expected if is_right else str(found), expected)


static func _number(text: String) -> float:
	return NAN if text == "nan" else float(text)


func _check(number: int, found: String, expected: String) -> void:
	_checks += 1
	if found != expected:
		_wrong += 1
		print("line %d: %s instead of %s" % [number, found, expected])
