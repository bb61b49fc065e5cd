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
	var clip := HapticClip.from_bytes(FileAccess.get_file_as_bytes(folder.path_join("behaviour.hfxclip")))
	var number := 0
	for line in FileAccess.get_file_as_string(folder.path_join("behaviour.txt")).split("\n"):
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
				_player.gain = NAN if argument == "nan" else float(argument)
			"pause":
				_player.pause(argument == "1")
			"stop":
				_player.stop()
			"seek":
				_player.seek(float(argument))
			"advance":
				var found := _player.advance(float(argument))
				var is_right := found.size() == 3
				for k in found.size():
					is_right = is_right and absf(found[k] - float(expected.get_slice(" ", k))) < 0.003
				_check(number, expected if is_right else str(found), expected)
			_:
				_check(number, "an unknown call", "")
	print("%d results, %d wrong" % [_checks, _wrong])
	quit(1 if _wrong > 0 or _checks < 60 else 0)


func _check(number: int, found: String, expected: String) -> void:
	_checks += 1
	if found != expected:
		_wrong += 1
		print("line %d: %s instead of %s" % [number, found, expected])
