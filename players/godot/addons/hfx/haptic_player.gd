# SPDX-License-Identifier: MIT
@icon("haptic_player.svg")
class_name HapticPlayer
extends HapticSource
## Plays a [HapticClip] in step with the game: each frame, of each actuator, the strongest row
## since the last frame.
##
## Values are sent each frame in which something plays, and once more when it ends.

## The clip came to its end by itself.
signal finished

const HapticPlaces := preload("haptic_places.gd")
const _LONGEST_FRAME := 0.5  # seconds of an animation; what is longer is a jump
const _EARLY := 1e-6  # of a row: times of frames are sums, and rounded

## Plays as soon as the node is in the scene.
@export var autoplay := false
## Begins again at the end. A named clip loops by itself if it is meant to; where this is set while
## a named clip plays, it applies to that, too.
@export var loop := false:
	set(value):
		loop = value
		_loops = value
## Scales how far all strengths are from neutral.
@export_range(0.0, 4.0, 0.01) var gain := 1.0

## Speed of the clip's time; 0 stands still. The frequencies stay.
@export_range(0.0, 4.0, 0.01, "or_greater") var speed := 1.0
@export_group("Place")
## Degrees by which all is turned about the body: to the left, seen from above counterclockwise. Only
## devices that go round the body, or are on both sides of it, are turned.
@export_range(-180.0, 180.0, 0.1, "or_less", "or_greater") var turn_degrees := 0.0:
	set(value):
		turn_degrees = value
		_shares.clear()
## Metres by which all is higher.
@export_range(-1.0, 1.0, 0.01, "or_less", "or_greater") var raise_m := 0.0:
	set(value):
		raise_m = value
		_shares.clear()
## Scales heights about the middle of each device.
@export_range(0.1, 4.0, 0.01, "or_greater") var stretch := 1.0:
	set(value):
		stretch = value
		_shares.clear()
@export_group("")

## Plays in step with this player's animation, wherever it plays, jumps or stops: with the named clip of
## the animation's name, else with the whole clip.
@export var follow: AnimationPlayer

var _playing := false
var _paused := false
var _followed := ""  # animation; empty: none
var _loops := false  # what plays now
var _position := 0.0
var _start := 0.0
var _end := 0.0
var _shown_row := -1
var _factors := {}
var _shares: Array = []  # for each actuator: [actuator, weight] of those whose values it plays


func _init() -> void:
	process_priority = 1  # when the animation has been advanced


func _ready() -> void:
	super()
	if autoplay and follow == null:
		play()


func _process(delta: float) -> void:
	if _paused or not _has_focus:
		return
	if is_instance_valid(follow):
		_follow()
	elif _playing:
		values_changed.emit(advance(delta * _positive(speed)))


## Begins at the beginning, or with a named clip of the scene. Gain, factors and loop stay. A name that
## the clip does not have is an error, and ends in silence; the result is false.
func play(named_clip := "") -> bool:
	if clip == null:
		push_error("HapticPlayer '%s' has no clip." % name)
		return false
	var part: Array = [0.0, clip.get_length(), loop]
	var is_known := named_clip == "" or clip.get_named_clips().has(named_clip)
	if not is_known:
		push_error(
			"HapticPlayer '%s': the clip has no '%s'; it has: %s."
			% [name, named_clip, ", ".join(clip.get_named_clips().keys())]
		)
		stop()
		part = [0.0, 0.0, false]
	elif named_clip != "":
		part = clip.get_named_clips()[named_clip]
	_start = part[0]
	_end = part[1]
	_loops = part[2]
	_playing = _end > _start
	_paused = false
	seek(_start)
	return is_known


## Stands still, in silence, until it is called with false.
func pause(is_paused := true) -> void:
	_paused = is_paused
	if is_paused:
		_silence()


## Ends in silence, at the beginning of what was played. Where a clip ends by itself, the position
## stays at its end.
func stop() -> void:
	var was_playing := _playing
	_playing = false
	_position = _start
	if was_playing:
		_silence()


## Jumps, seconds from the beginning of the clip; what lies between is not felt.
func seek(seconds: float) -> void:
	if clip == null:
		return
	_position = clampf(_positive(seconds), _start, _end)
	_shown_row = _row_of(_position) - 1


## Scales one parameter (amplitude_m_s2, frequency_hz, pressure_kpa, temperature_c, speed_m_s): its
## deviation from neutral, a frequency itself; false, without effect: the clip has no such parameter.
func set_parameter(parameter: String, factor: float) -> bool:
	if clip != null and not parameter.begins_with("direction"):  # directions are not scaled
		for column in clip.get_columns():
			if column.parameter == parameter:
				_factors[parameter] = _positive(factor)
				return true
	return false


func is_playing() -> bool:
	return _playing


## Seconds from the beginning of the clip.
func get_playback_position() -> float:
	return _position


## Goes on by seconds and gives all columns. [method _process] calls it; a game that has a clock of
## its own may do so instead, with the node's processing off.
func advance(seconds: float) -> PackedFloat32Array:
	if clip == null:
		return PackedFloat32Array()
	if not _playing or _paused:
		return clip.get_neutral_values()
	_position += _positive(seconds)
	var now := _row_of(_position)
	var spans := [Vector2i(_shown_row + 1, now)]
	if _position < _end:
		spans[0].x = mini(spans[0].x, now)
	elif _loops:
		var past := _position - _end
		var length := _end - _start
		_position = _start + fmod(past, length)
		now = _row_of(_position)
		spans.append(Vector2i(_row_of(_start), now if past < length else _row_of(_end)))
	else:
		_playing = false
		_position = _end
		finished.emit.call_deferred()
		_silence.call_deferred()
		if spans[0].x > now:  # all of it has been felt
			return clip.get_neutral_values()
	_shown_row = now
	return _strongest(spans)


## Plays what is between the place of the animation in the last frame and now.
func _follow() -> void:
	var animation := follow.current_animation if follow.is_playing() else ""
	if animation == "" or clip == null:
		if _followed != "":
			_followed = ""
			stop()
		return
	var now := follow.current_animation_position
	if animation != _followed:
		_followed = animation
		play(animation if clip.get_named_clips().has(animation) else "")
		seek(_start + now)
		values_changed.emit(advance(0.0))
		return
	var length := follow.current_animation_length
	var passed := _start + now - _position
	var is_loop := follow.get_animation(animation).loop_mode == Animation.LOOP_LINEAR
	_loops = is_loop and is_equal_approx(length, _end - _start)
	if _loops and passed < 0.0:
		passed += length  # it has begun again
	if not _playing:
		if passed >= 0.0:
			return  # the clip is over before the animation is
		_playing = true
	if passed < 0.0 or passed > _LONGEST_FRAME:  # it has jumped
		seek(_start + now)
		passed = 0.0
	values_changed.emit(advance(passed))


## What is not a number or below 0 counts as 0; products of what is not infinite stay numbers.
static func _positive(value: float) -> float:
	return minf(value, 3.4e38) if value > 0.0 else 0.0


func _row_of(seconds: float) -> int:
	var rate := clip.get_rate_hz()
	var last := ceilf(_end * rate - _EARLY) - 1.0
	var first := clampf(floorf(_start * rate + _EARLY), 0.0, maxf(last, 0.0))
	return int(clampf(floorf(seconds * rate + _EARLY), first, maxf(last, first)))


func _strongest(spans: Array) -> PackedFloat32Array:
	var columns := clip.get_columns()
	var actuators := clip.get_actuators()
	var bytes := clip.bytes
	var out := PackedFloat32Array()
	out.resize(columns.size())
	if HapticPlaces.is_elsewhere(turn_degrees, raise_m, stretch):
		_strongest_placed(spans, out)
		return out
	for actuator in actuators:
		var strongest := _strongest_value(actuator, spans)
		for k in actuator.columns:
			var column: int = actuator.first_column + k
			var number := bytes.decode_u16(strongest + 2 * k)
			out[column] = _scaled(columns[column], _decoded(columns[column], number), k == 0)
	return out


## Turned, raised or stretched: each actuator plays shares of others' values.
func _strongest_placed(spans: Array, out: PackedFloat32Array) -> void:
	var columns := clip.get_columns()
	var actuators := clip.get_actuators()
	var bytes := clip.bytes
	if _shares.size() != actuators.size():
		_shares = HapticPlaces.find_shares(clip, turn_degrees, raise_m, stretch)
	for index in actuators.size():
		var sum := 0.0
		var most := -1.0
		var main := {}
		var values := 0
		for share: Array in _shares[index]:
			var from: Dictionary = actuators[share[0]]
			var at := _strongest_value(from, spans)
			var strength: Dictionary = columns[from.first_column]
			var away: float = share[1] * (_decoded(strength, bytes.decode_u16(at)) - strength.neutral)
			sum += away
			if absf(away) > most:
				most = absf(away)
				main = from
				values = at
		var first: int = actuators[index].first_column
		for k in actuators[index].columns:
			var column: Dictionary = columns[first + k]
			var value: float = column.neutral + (sum if k == 0 else 0.0)
			if k > 0 and not main.is_empty() and k < main.columns:
				value = _decoded(columns[main.first_column + k], bytes.decode_u16(values + 2 * k))
			out[first + k] = clampf(_scaled(column, value, k == 0), column.lowest, column.highest)


## The byte of the strongest row of an actuator.
func _strongest_value(actuator: Dictionary, spans: Array) -> int:
	var rows: PackedInt32Array = actuator.rows
	var size: int = 2 * actuator.columns
	var neutral: int = clip.get_columns()[actuator.first_column].neutral_number
	var bytes := clip.bytes
	var strongest: int = actuator.values
	var farthest := 0
	for span in spans:
		if span.x > span.y:
			continue
		for entry in range(_entry_at(rows, span.x), _entry_at(rows, span.y) + 1):
			var at: int = actuator.values + size * entry
			var away := absi(bytes.decode_u16(at) - neutral)
			if away >= farthest:
				farthest = away
				strongest = at
	return strongest


## The entry of an actuator that holds at a row.
static func _entry_at(rows: PackedInt32Array, row: int) -> int:
	return maxi(rows.bsearch(row, false) - 1, 0)


static func _decoded(column: Dictionary, number: int) -> float:
	if number == column.neutral_number:
		return column.neutral
	return column.lowest + (column.highest - column.lowest) * number / 65535.0


func _scaled(column: Dictionary, value: float, is_strength: bool) -> float:
	var neutral: float = column.neutral if is_strength else 0.0
	var factor: float = _factors.get(column.parameter, 1.0) * (_positive(gain) if is_strength else 1.0)
	if factor == 1.0:
		return value
	return clampf(neutral + factor * (value - neutral), column.lowest, column.highest)


## The clip is about to change.
func _forget() -> void:
	_shares.clear()
	super()
