# SPDX-License-Identifier: MIT
class_name HapticControllers
extends Node
## Plays the vibrations of a [HapticPlayer], of a [HapticBody], or of both on the two controllers of an OpenXR headset.
##
## Vibration actuators of the chosen device that are worn on the left go to the left controller,
## those on the right to the right one; of several the strongest counts. Each pulse ends by itself
## after the device's dead-man time, should the game hang.

const _SILENCE_S := 0.01

@export var player: HapticPlayer:
	set(value):
		_change(player, value)
		player = value
## Plays what it feels, too.
@export var body: HapticBody:
	set(value):
		_change(body, value)
		body = value
## Further players and bodies, say a second body of the same avatar with another clip.
@export var sources: Array[HapticSource] = []:
	set(value):
		for source in sources:
			_change(source, null)
		sources = value
		for source in sources:
			_change(null, source)
@export var left: XRController3D
@export var right: XRController3D
## The haptic action of the project's OpenXR action map.
@export var action := "haptic"
## Id of a device in the clip (say oculus_touch), with or without its _left or _right; empty: all.
@export var device := "":
	set(value):
		device = value
		_felt.clear()

var _felt := {}  # source: [its clip, its columns by side, its newest values]
var _on := {"left": false, "right": false}


func _change(before: HapticSource, after: HapticSource) -> void:
	if is_instance_valid(before) and before.values_changed.is_connected(_play):
		before.values_changed.disconnect(_play)
		_felt.erase(before)
	if after != null and not after.values_changed.is_connected(_play):
		after.values_changed.connect(_play.bind(after))


func _play(values: PackedFloat32Array, source: HapticSource) -> void:
	if not _felt.has(source) or _felt[source][0] != source.clip:
		_felt[source] = [source.clip, _columns_of(source.clip), values]
	_felt[source][2] = values
	for side in ["left", "right"]:
		_pulse(side)


func _pulse(side: String) -> void:
	var controller := left if side == "left" else right
	if controller == null:
		return
	var amplitude := 0.0
	var frequency_hz := 0.0
	var seconds := 0.0
	for source in _felt.values():
		var values: PackedFloat32Array = source[2]
		for found in source[1][side]:  # strength column, its highest, frequency column or -1, seconds
			var share: float = values[found[0]] / found[1]
			if share > amplitude:
				amplitude = share
				frequency_hz = values[found[2]] if found[2] >= 0 else 0.0
				seconds = found[3]
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
	for index in clip.find_devices(device):
		var each := clip.get_devices()[index]
		for k in range(each.first_actuator, mini(each.first_actuator + each.actuators, actuators.size())):
			var actuator: Dictionary = actuators[k]
			if actuator.modality == "vibration" and found.has(actuator.side):
				var frequency: int = actuator.first_column + 1 if actuator.columns > 1 else -1
				var highest: float = clip.get_columns()[actuator.first_column].highest
				found[actuator.side].append(
					[actuator.first_column, highest, frequency, each.dead_man_ms / 1000.0]
				)
	return found
