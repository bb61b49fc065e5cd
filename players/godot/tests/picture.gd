# SPDX-License-Identifier: MIT
extends SceneTree
## Takes a picture of the garage at a moment of its clip:
## godot --path . --xr-mode off --resolution 720x405 --script tests/picture.gd -- PICTURE.png SECONDS


func _initialize() -> void:
	var wanted := OS.get_cmdline_user_args()
	var garage: Node = load("res://addons/hfx/samples/garage.tscn").instantiate()
	root.add_child(garage)
	await process_frame
	var player: HapticPlayer = garage.get_node("Player")
	player.set_process(false)
	player.seek(float(wanted[1]) - 0.1)
	player.values_changed.emit(player.advance(0.1))
	for frame in 2:
		await process_frame
	await RenderingServer.frame_post_draw
	quit(root.get_texture().get_image().save_png(wanted[0]))
