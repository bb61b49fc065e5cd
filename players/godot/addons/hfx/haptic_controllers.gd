# SPDX-License-Identifier: MIT
class_name HapticControllers
extends Node
## Plays the vibrations of a [HapticPlayer], of a [HapticBody], or of both on the two controllers of a
## headset, on a gamepad and on a phone.
##
## As a child of a player or a body the node needs no settings. Actuators on the left play on the left
## controller, those on the right on the right one. On a gamepad the left plays on the strong motor, the
## right on the weak one, all others on both. Of several actuators the strongest counts. Each pulse ends
## by itself after the device's dead-man time, should the game hang.

const _SILENCE_S := 0.01
const _PHONE_S := 0.05
const _PHONE_PULSE_MS := 70

@export var player: HapticPlayer:
	set(value):
		_change(player, value)
		player = value
## A body to play, too.
@export var body: HapticBody:
	set(value):
		_change(body, value)
		body = value
## Further players and bodies, say a second body of the same avatar with another clip. Where there is
## neither player nor body nor source: the parent node.
@export var sources: Array[HapticSource] = []:
	set(value):
		for source in sources:
			_change(source, null)
		sources = value
		for source in sources:
			_change(null, source)
## Controllers; where both are empty, the first ones in the scene with the trackers left_hand and right_hand.
@export var left: XRController3D
@export var right: XRController3D
## The haptic action of the project's OpenXR action map.
@export var action := "haptic"
## Number of a gamepad that plays while no headset is in use; -1: none.
@export_range(-1, 15) var gamepad := 0
## Plays on the phone that runs the game, too: needs Android's permission VIBRATE.
@export var vibrates_phone := false
## Id of a device in the clip (say oculus_touch), with or without its _left or _right; empty: all.
@export var device := "":
	set(value):
		device = value
		_felt.clear()

var _felt := {}  # source: [its clip, its columns by side, its newest values]
var _on := {}  # sides and outputs that vibrate
var _phone_ms := 0  # time of the last pulse


func _ready() -> void:
	if player == null and body == null and sources.is_empty() and get_parent() is HapticSource:
		sources = [get_parent()]
	if left == null and right == null:
		left = _find_controller(&"left_hand")
		right = _find_controller(&"right_hand")


func _change(before: HapticSource, after: HapticSource) -> void:
	if is_instance_valid(before) and before.values_changed.is_connected(_play):
		before.values_changed.disconnect(_play)
		_felt.erase(before)
	if after != null and not after.values_changed.is_connected(_play):
		after.values_changed.connect(_play.bind(after))


func _find_controller(tracker: StringName) -> XRController3D:
	for node: XRController3D in get_tree().root.find_children("*", "XRController3D", true, false):
		if node.tracker == tracker:
			return node
	return null


func _play(values: PackedFloat32Array, source: HapticSource) -> void:
	if not _felt.has(source) or _felt[source][0] != source.clip:
		_felt[source] = [source.clip, _columns_of(source.clip), values]
	_felt[source][2] = values
	_pulse("left", left)
	_pulse("right", right)
	_vibrate_gamepad()
	if vibrates_phone:
		_vibrate_phone()


func _pulse(side: String, controller: XRController3D) -> void:
	if controller == null:
		return
	var pulse := _strongest([side])
	if pulse.share > 0.0:
		controller.trigger_haptic_pulse(action, pulse.hertz, pulse.share, pulse.seconds, 0.0)
	elif _on.has(side):  # a pulse of nothing takes the place of the running one
		controller.trigger_haptic_pulse(action, 0.0, 0.0, _SILENCE_S, 0.0)
	_set_on(side, pulse.share > 0.0)


func _vibrate_gamepad() -> void:
	if gamepad < 0 or not is_inside_tree() or get_viewport().use_xr:
		return
	var strong := _strongest(["left", ""])
	var weak := _strongest(["right", ""])
	var is_on: bool = strong.share > 0.0 or weak.share > 0.0
	if is_on:
		var seconds := maxf(strong.seconds, weak.seconds)
		Input.start_joy_vibration(gamepad, weak.share, strong.share, seconds)
	elif _on.has("gamepad"):
		Input.stop_joy_vibration(gamepad)
	_set_on("gamepad", is_on)


func _vibrate_phone() -> void:
	var pulse := _strongest(["left", "right", ""])
	var now := Time.get_ticks_msec()
	if pulse.share <= 0.0 or now - _phone_ms < 1000 * _PHONE_S:
		return
	_phone_ms = now
	if Engine.get_version_info().hex >= 0x040300:  # before, phones have no amplitudes
		Input.call(&"vibrate_handheld", _PHONE_PULSE_MS, pulse.share)
	else:
		Input.vibrate_handheld(_PHONE_PULSE_MS)


func _set_on(output: String, is_on: bool) -> void:
	if is_on:
		_on[output] = true
	else:
		_on.erase(output)


## The strongest vibration of all sources on these sides: share of the highest, 0 to 1; hertz; seconds
## after which it ends by itself.
func _strongest(sides: Array[String]) -> Dictionary:
	var pulse := {"share": 0.0, "hertz": 0.0, "seconds": 0.0}
	for source in _felt.values():
		var values: PackedFloat32Array = source[2]
		for side in sides:
			for vibration in source[1][side]:
				var share: float = values[vibration.strength] / vibration.highest
				if share > pulse.share:
					pulse.share = minf(share, 1.0)
					pulse.hertz = values[vibration.frequency] if vibration.frequency >= 0 else 0.0
					pulse.seconds = vibration.seconds
	return pulse


## Vibration actuators by their side: columns of strength and frequency (-1: none), highest strength,
## dead-man time.
func _columns_of(clip: HapticClip) -> Dictionary:
	var vibrations := {"left": [], "right": [], "": []}
	if clip == null:
		return vibrations
	var actuators := clip.get_actuators()
	for index in clip.find_devices(device):
		var owner_device := clip.get_devices()[index]
		var first: int = owner_device.first_actuator
		for k in range(first, mini(first + owner_device.actuators, actuators.size())):
			var actuator: Dictionary = actuators[k]
			if actuator.modality != "vibration":
				continue
			vibrations[actuator.side].append({
				"strength": actuator.first_column,
				"highest": clip.get_columns()[actuator.first_column].highest,
				"frequency": actuator.first_column + 1 if actuator.columns > 1 else -1,
				"seconds": owner_device.dead_man_ms / 1000.0,
			})
	return vibrations
