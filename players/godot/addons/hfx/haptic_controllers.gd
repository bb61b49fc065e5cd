# SPDX-License-Identifier: MIT
class_name HapticControllers
extends Node
## Plays the vibrations of a [HapticPlayer] on the two controllers of an OpenXR headset.
##
## Vibration actuators of the chosen device that are worn on the left go to the left controller,
## those on the right to the right one; of several the strongest counts. Each pulse ends by itself
## after the device's dead-man time, should the game hang.

const _SILENCE_S := 0.01

@export var player: HapticPlayer:
	set(value):
		if player != null and player.values_changed.is_connected(_play):
			player.values_changed.disconnect(_play)
		player = value
		if player != null:
			player.values_changed.connect(_play)
@export var left: XRController3D
@export var right: XRController3D
## The haptic action of the project's OpenXR action map.
@export var action := "haptic"
## Id of a device in the clip (say oculus_touch); empty: all devices.
@export var device := ""

var _sides := {}  # "left", "right": [strength column, frequency column or -1, dead-man seconds]
var _clip: HapticClip
var _on := {"left": false, "right": false}


func _play(values: PackedFloat32Array) -> void:
	if player.clip != _clip:
		_clip = player.clip
		_sides = _columns_of(_clip)
	for side in ["left", "right"]:
		_pulse(side, values)


func _pulse(side: String, values: PackedFloat32Array) -> void:
	var controller := left if side == "left" else right
	if controller == null:
		return
	var columns := _clip.get_columns()
	var amplitude := 0.0
	var frequency_hz := 0.0
	var seconds := 0.0
	for found in _sides[side]:
		var share: float = values[found[0]] / columns[found[0]].highest
		if share > amplitude:
			amplitude = share
			frequency_hz = values[found[1]] if found[1] >= 0 else 0.0
			seconds = found[2]
	if amplitude > 0.0:
		controller.trigger_haptic_pulse(action, frequency_hz, amplitude, seconds, 0.0)
	elif _on[side]:  # a pulse of nothing takes the place of the one that runs
		controller.trigger_haptic_pulse(action, 0.0, 0.0, _SILENCE_S, 0.0)
	_on[side] = amplitude > 0.0


func _columns_of(clip: HapticClip) -> Dictionary:
	var found := {"left": [], "right": []}
	if clip == null:
		return found
	var actuators := clip.get_actuators()
	for each in clip.get_devices():
		if device != "" and each.id != device and each.id.trim_suffix("_left").trim_suffix("_right") != device:
			continue
		for k in range(each.first_actuator, mini(each.first_actuator + each.actuators, actuators.size())):
			var actuator: Dictionary = actuators[k]
			if actuator.modality == "vibration" and found.has(actuator.side):
				var frequency: int = actuator.first_column + 1 if actuator.columns > 1 else -1
				found[actuator.side].append([actuator.first_column, frequency, each.dead_man_ms / 1000.0])
	return found
