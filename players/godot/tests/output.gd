# SPDX-License-Identifier: MIT
extends SceneTree
## Plays a clip through HapticOutput to 'hfx play CLIP --device ID --listen 7010': godot --headless
## --script tests/output.gd -- CLIP ID. The token is that of HFX_TOKEN.


func _init() -> void:
	_run.call_deferred(OS.get_cmdline_user_args())


func _run(arguments: PackedStringArray) -> void:
	var player := HapticPlayer.new()
	player.clip = HapticClip.from_bytes(FileAccess.get_file_as_bytes(arguments[0]))
	var output := HapticOutput.new()
	output.sources = [player]
	output.device = arguments[1]
	root.add_child(player)
	root.add_child(output)
	player.play()
	await player.finished
	quit(0)
