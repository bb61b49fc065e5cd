# SPDX-License-Identifier: MIT
extends RefCounted
## Where the values of actuators come from while a clip is turned about the body, raised or stretched:
## docs/formats/clip.md, "Turned and raised".

const _AXIS_Y_M := -0.045  # the vertical axis of the canonical body; x is 0
const _LEVEL_M := 0.01  # height of a level


static func is_elsewhere(turn_degrees: float, raise_m: float, stretch: float) -> bool:
	return (
		_turn(turn_degrees) != 0.0
		or (is_finite(raise_m) and raise_m != 0.0)
		or (is_finite(stretch) and stretch > 0.0 and stretch != 1.0)
	)


## For each actuator: [actuator, weight] of up to four actuators whose values it plays.
static func find_shares(clip: HapticClip, turn_degrees: float, raise_m: float, stretch: float) -> Array:
	var actuators := clip.get_actuators()
	var shares: Array = []
	for k in actuators.size():
		shares.append([[k, 1.0]])
	var turn := _turn(turn_degrees)
	var raised := raise_m if is_finite(raise_m) else 0.0
	var stretched := stretch if is_finite(stretch) and stretch > 0.0 else 1.0
	for device in clip.get_devices():
		for modality in HapticClip.MODALITIES:
			var levels := _levels(actuators, device, modality)
			for level in levels.size():
				var wanted := _wanted(levels, level, raised, stretched)
				for k: int in levels[level].actuators:
					shares[k] = _shares_of(actuators, levels, level, k, turn, wanted)
	return shares


static func _turn(degrees: float) -> float:
	return fposmod(degrees, 360.0) if is_finite(degrees) else 0.0


## Actuators on the body of one modality of a device, by height: actuators, height, box, is_round.
static func _levels(actuators: Array[Dictionary], device: Dictionary, modality: String) -> Array:
	var sorted: Array = []
	for k in range(device.first_actuator, device.first_actuator + device.actuators):
		if actuators[k].place != "room" and actuators[k].modality == modality:
			sorted.append(k)
	sorted.sort_custom(func(a: int, b: int) -> bool:
		var way: float = actuators[a].centre_m.z - actuators[b].centre_m.z
		return way < 0.0 or (way == 0.0 and a < b))
	var levels: Array = []
	for k: int in sorted:
		var centre: Vector3 = actuators[k].centre_m
		if levels.is_empty() or centre.z > levels[-1].low + _LEVEL_M:
			var plain := Rect2(centre.x, centre.y, 0.0, 0.0)
			levels.append({"actuators": [], "low": centre.z, "box": plain, "sides": {}})
		levels[-1].actuators.append(k)
		levels[-1].box = levels[-1].box.expand(Vector2(centre.x, centre.y))
		levels[-1].sides[actuators[k].side] = true
		levels[-1].height = 0.5 * (levels[-1].low + centre.z)
	for level: Dictionary in levels:
		var box: Rect2 = level.box
		level.actuators.sort()
		level.is_round = (
			(level.sides.size() == 2 and not level.sides.has(""))
			or (
				box.position.x <= 0.0 and box.end.x >= 0.0
				and box.position.y <= _AXIS_Y_M and box.end.y >= _AXIS_Y_M
			)
		)
	return levels


static func _wanted(levels: Array, level: int, raise_m: float, stretch: float) -> float:
	var height: float = levels[level].height
	if levels.size() < 2:
		return height
	var middle: float = 0.5 * (levels[0].height + levels[-1].height)
	return middle + (height - middle - raise_m) / stretch


static func _shares_of(
	actuators: Array[Dictionary], levels: Array, own: int, actuator: int, turn: float, wanted: float
) -> Array:
	var shares: Array = []
	for k in levels.size():
		var below: float = levels[k].height - levels[k - 1].height if k > 0 else INF
		var above: float = levels[k + 1].height - levels[k].height if k + 1 < levels.size() else below
		if k == 0:
			below = above
		var away: float = wanted - levels[k].height
		var weight: float = 1.0 - absf(away) / (below if away < 0.0 else above)
		if weight <= 0.0:
			continue
		if k == own and (not levels[k].is_round or turn == 0.0):
			shares.append([actuator, weight])
		else:
			shares.append_array(_neighbours(actuators, levels[k], actuator, turn, weight))
	return shares


## The one or two neighbours of an actuator's place, by angle where the level goes round, else by x.
static func _neighbours(
	actuators: Array[Dictionary], level: Dictionary, actuator: int, turn: float, weight: float
) -> Array:
	var middle: Vector2 = level.box.get_center()
	var place := Vector2(actuators[actuator].centre_m.x, actuators[actuator].centre_m.y)
	var at := rad_to_deg((place - middle).angle()) - turn if level.is_round else place.x
	var before := INF
	var after := INF
	var previous := -1
	var next := -1
	for k: int in level.actuators:
		var centre := Vector2(actuators[k].centre_m.x, actuators[k].centre_m.y)
		var back := at - centre.x
		var ahead := -back
		if level.is_round:
			var angle := rad_to_deg((centre - middle).angle())
			back = fposmod(at - angle, 360.0)
			ahead = fposmod(angle - at, 360.0)
		if back >= 0.0 and back < before:
			before = back
			previous = k
		if ahead >= 0.0 and ahead < after:
			after = ahead
			next = k
	if previous < 0 or next < 0 or previous == next:
		return [[maxi(previous, next), weight]]
	var share := weight * after / (before + after) if before > 0.0 else weight
	return [[previous, share], [next, weight - share]]
