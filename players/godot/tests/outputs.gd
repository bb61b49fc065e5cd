# SPDX-License-Identifier: MIT
extends SceneTree
## Checks HapticControllers without settings, on a gamepad: godot --headless --script tests/outputs.gd --
## FILE, of players/conformance/demo_garage.hfxclip. Ends with 1 if a check fails.

var _failed := 0


func _init() -> void:
	_run.call_deferred(OS.get_cmdline_user_args()[0])


func _run(file: String) -> void:
	var player := HapticPlayer.new()
	player.clip = HapticClip.from_bytes(FileAccess.get_file_as_bytes(file))
	var controllers := HapticControllers.new()
	player.add_child(controllers)
	var hands := {}
	for tracker in [&"left_hand", &"right_hand"]:
		hands[tracker] = XRController3D.new()
		hands[tracker].tracker = tracker
		root.add_child(hands[tracker])
	root.add_child(player)
	_is("the parent plays", controllers.sources, [player])
	_is("left controller", controllers.left, hands[&"left_hand"])
	_is("right controller", controllers.right, hands[&"right_hand"])

	_send(player, {"left": 0.5, "right": 0.25})
	_is("weak and strong motor", Input.get_joy_vibration_strength(0), Vector2(0.25, 0.5))
	_send(player, {"": 0.75, "right": 0.25})
	_is("both motors", Input.get_joy_vibration_strength(0), Vector2(0.75, 0.75))
	_send(player, {})
	_is("silence", Input.get_joy_vibration_strength(0), Vector2.ZERO)
	controllers.gamepad = 1
	_send(player, {"left": 1.0})
	_is("another gamepad", Input.get_joy_vibration_strength(1), Vector2(0.0, 1.0))
	_is("not the first", Input.get_joy_vibration_strength(0), Vector2.ZERO)
	quit(1 if _failed > 0 else 0)


## Sends neutral values, with a share of the highest on the first vibration actuator of each side.
func _send(player: HapticPlayer, shares: Dictionary) -> void:
	var values := player.clip.get_neutral_values()
	for side in shares:
		for actuator in player.clip.get_actuators():
			if actuator.side == side and actuator.modality == "vibration":
				values[actuator.first_column] = shares[side] * player.clip.get_columns()[actuator.first_column].highest
				break
	player.values_changed.emit(values)


func _is(what: String, value: Variant, expected: Variant) -> void:
	if value != expected:
		_failed += 1
		printerr("%s: %s, expected %s" % [what, value, expected])
