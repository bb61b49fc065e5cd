# SPDX-License-Identifier: MIT
@tool
@icon("haptic_player.svg")
class_name HapticSurface
extends HapticSource
## A haptic surface of a clip: vibrates under a finger, a pointer or a controller that moves over it.
##
## Call [method touch], [method touch_texture], [method touch_at] or [method touch_event] with each place, and
## [method release] as the touch ends. Each frame the strongest texel on the path since the last
## frame plays; a resting finger feels nothing. It plays on [member controller] and on the phone;
## [HapticOutput] takes it as one of its sources.

## Each frame of a touch, and once more as it ends: peak amplitude, and frequency.
signal felt(amplitude_m_s2: float, frequency_hz: float)

const REST_MM_S := 0.1
const MOST_TILES := 4.0  # length of a path along one axis
const FARTHEST_UV := 1e6
const _HOLD_S := 0.05  # pointers are slower than frames
const _PULSE_S := 0.1  # ends by itself, should the game hang
const _PHONE_S := 0.05
const _PHONE_PULSE_MS := 70

## Name of the surface in the clip; empty: its first. Another surface begins a new touch.
@export var surface := "":
	set(value):
		if value != surface:
			_is_touching = false
		surface = value
		_is_sought = false
## How often the map stands side by side on the plane, or in the area of a pointer.
@export var repeat := Vector2.ONE
## Scales all amplitudes.
@export_range(0.0, 4.0, 0.01) var gain := 1.0
@export_group("Controller and Phone")
## Plays here; may be empty.
@export var controller: XRController3D
## The haptic action of the project's OpenXR action map.
@export var action := "haptic"
## Plays on the phone that runs the game, too: needs Android's permission VIBRATE.
@export var vibrates_phone := false
## Peak amplitude of controller and phone at full strength, m/s²: 1.3 g, as of the map paper's phone.
@export_range(0.1, 100.0, 0.01) var full_m_s2 := 12.75
@export_group("Device")
## Id of the device that plays it by a HapticOutput, with or without _left or _right; empty: all.
@export var device := ""
## Id of one of its actuators, say index; empty: all for vibration.
@export var actuator := ""

var _found := {}  # the surface, as of HapticClip.get_surfaces; empty: not there
var _is_sought := false
var _is_touching := false
var _u := 0.0
var _v := 0.0
var _places := PackedFloat64Array()  # u, v and speed of each since the last frame
var _waited_s := 0.0
var _amplitude := 0.0
var _frequency_hz := 0.0
var _phone_s := 0.0
var _is_on := false  # the controller
var _finger := -1  # of the touch; -1: none


func _process(delta: float) -> void:
	if Engine.is_editor_hint() or not _has_focus:
		return
	_phone_s -= delta
	_waited_s += delta
	var count := _places.size() / 3
	if count > 0:
		_amplitude = 0.0
		for k in count:
			var each := feel(_places[3 * k], _places[3 * k + 1], _places[3 * k + 2], _waited_s / count)
			if each.x > _amplitude or k == 0:
				_amplitude = each.x
				_frequency_hz = each.y
		_places.clear()
		_waited_s = 0.0
	elif _waited_s > _HOLD_S:
		_amplitude = 0.0
	if count > 0 or _is_on or _amplitude > 0.0:
		_play()


## Something touches the surface at a place: shares of the map's width and height from its lower
## left corner, beyond 0 to 1, too. Speed relative to the material, mm/s; below 0: that of the path.
func touch(uv: Vector2, speed_mm_s := -1.0) -> void:
	_places.append_array([uv.x, uv.y, speed_mm_s])


## Something touches the object of the scene at its texture coordinates: to scale, as in Blender. V is
## upwards: Vector2(x, 1 - y) of a glTF file's.
func touch_texture(uv: Vector2, speed_mm_s := -1.0) -> void:
	_find()
	if _found.is_empty():
		return
	var scale := Vector2(_found.uv_width_mm / _found.width_mm, _found.uv_height_mm / _found.height_mm)
	touch(uv * scale if scale.x > 0.0 and scale.y > 0.0 else uv * repeat, speed_mm_s)


## Something touches a mesh of the class QuadMesh or PlaneMesh at a point of the world.
func touch_at(point: Vector3, plane: MeshInstance3D, speed_mm_s := -1.0) -> void:
	var mesh := plane.mesh as PlaneMesh
	if mesh == null:
		push_error("HapticSurface '%s': the mesh has to be a QuadMesh or a PlaneMesh." % name)
		return
	var at := plane.to_local(point) - mesh.center_offset
	var on_plane := Vector2(at.x, -at.z)
	match mesh.orientation:
		PlaneMesh.FACE_X:
			on_plane = Vector2(-at.z, at.y)
		PlaneMesh.FACE_Z:
			on_plane = Vector2(at.x, at.y)
	touch((on_plane / mesh.size + 0.5 * Vector2.ONE) * repeat, speed_mm_s)


## Takes the events of a mouse with its left button down, or of the first finger on a screen, in an
## area in the coordinates of the event; true: it touches. A finger beyond the area, or one that ends,
## releases.
func touch_event(event: InputEvent, area: Rect2) -> bool:
	var at := Vector2.ZERO
	var is_down := true
	if event is InputEventScreenTouch or event is InputEventScreenDrag:
		if _finger >= 0 and event.index != _finger:
			return false
		_finger = event.index
		at = event.position
		is_down = event is InputEventScreenDrag or event.is_pressed()
	elif event is InputEventMouseMotion:
		at = event.position
		is_down = event.button_mask & MOUSE_BUTTON_MASK_LEFT != 0
	elif event is InputEventMouseButton and event.button_index == MOUSE_BUTTON_LEFT:
		at = event.position
		is_down = event.is_pressed()
	else:
		return false
	if not is_down or not area.has_point(at):
		release()
		return false
	var share := (at - area.position) / area.size
	touch(Vector2(share.x, 1.0 - share.y) * repeat)
	return true


## Ends the touch, in silence.
func release() -> void:
	_finger = -1
	_is_touching = false
	_places.clear()
	_amplitude = 0.0
	if _is_on:
		_play()


## What is felt at a place, `seconds` after the call before: peak amplitude in m/s² and frequency in
## Hz. [method _process] calls it; a game that has a clock of its own may do so instead, with the
## node's processing off.
func feel(u: float, v: float, speed_mm_s: float, seconds: float) -> Vector2:
	_find()
	var is_place := absf(u) <= FARTHEST_UV and absf(v) <= FARTHEST_UV  # false for NaN
	if _found.is_empty() or not is_place:
		_is_touching = false
		return Vector2.ZERO
	var is_moving := _is_touching
	if not is_moving:
		_u = u
		_v = v
	var begin_u := _u
	var begin_v := _v
	var path_mm := Vector2((u - _u) * _found.width_mm, (v - _v) * _found.height_mm).length()
	var tiles := maxf(absf(u - _u), absf(v - _v))
	if tiles > MOST_TILES:  # only the end of a path that is too long
		begin_u = u - (u - _u) * (MOST_TILES / tiles)
		begin_v = v - (v - _v) * (MOST_TILES / tiles)
	if speed_mm_s >= 0.0:
		is_moving = is_moving and speed_mm_s > REST_MM_S
	else:
		is_moving = is_moving and path_mm > REST_MM_S * maxf(seconds, 0.0)
	_is_touching = true
	_u = u
	_v = v
	var columns: int = _found.columns
	var rows: int = _found.rows
	var texel := _strongest(begin_u * columns, begin_v * rows, u * columns, v * rows)
	var intensity := texel >> 8
	var amplitude := 0.0
	if is_moving and intensity > 0:
		amplitude = lerpf(_found.lowest_m_s2, _found.highest_m_s2, intensity / 16777215.0)
	return Vector2(amplitude, lerpf(_found.lowest_hz, _found.highest_hz, (texel & 255) / 255.0))


func _find() -> void:
	if _is_sought or clip == null:
		return
	_is_sought = true
	_found = {}
	var names := PackedStringArray()
	for each in clip.get_surfaces():
		names.append(each.name)
		if _found.is_empty() and (surface == "" or each.name == surface):
			_found = each
	if _found.is_empty():
		push_error("HapticSurface '%s': the clip has no surface '%s', but: %s." % [name, surface, ", ".join(names)])


func _forget() -> void:
	super()
	_is_sought = false
	_found = {}


func _silence() -> void:
	release()
	super()


func _validate_property(property: Dictionary) -> void:
	if property.name == "surface" and clip != null:
		var names := clip.get_surfaces().map(func(each: Dictionary) -> String: return each.name)
		property.hint = PROPERTY_HINT_ENUM_SUGGESTION
		property.hint_string = ",".join(names)


## Strongest texel on the straight path between two places in texels: the texel of its beginning,
## and each that it enters where it crosses a line between columns or rows.
func _strongest(begin_x: float, begin_y: float, end_x: float, end_y: float) -> int:
	var best := _texel_at(floorf(begin_x), floorf(begin_y), Vector2i(0, 0x7FFFFFFF))
	for axis in 2:
		var begin := begin_x if axis == 0 else begin_y
		var begin_across := begin_y if axis == 0 else begin_x
		var way := (end_x if axis == 0 else end_y) - begin
		var across := (end_y if axis == 0 else end_x) - begin_across
		var first := floorf(begin)
		var step := -1.0 if way < 0.0 else 1.0
		var crossed := int(absf(floorf(begin + way) - first))
		for line in range(1, crossed + 1):
			# Rightwards line first + 1 comes first; leftwards the line first itself.
			var share := (first - begin + (1.0 if way < 0.0 else 0.0) + step * line) / way
			var along := first + step * line
			var other := floorf(begin_across + share * across)
			best = _texel_at(along if axis == 0 else other, other if axis == 0 else along, best)
	return best.x & 0xFFFFFFFF


## The stronger of a texel and the best one so far, each as texel and number; of equal ones the lower.
func _texel_at(column: float, row: float, best: Vector2i) -> Vector2i:
	var number := _cell(row, _found.rows) * int(_found.columns) + _cell(column, _found.columns)
	var texel := clip.bytes.decode_u32(_found.texels + 4 * number)
	var intensity := texel >> 8
	var strongest := (best.x & 0xFFFFFFFF) >> 8
	if intensity > strongest or (intensity == strongest and number < best.y):
		return Vector2i(texel, number)
	return best


func _cell(cell: float, count: int) -> int:
	return int(fposmod(cell, count)) if _found.tiles else int(clampf(cell, 0.0, count - 1.0))


func _play() -> void:
	var amplitude_m_s2 := _amplitude * gain
	felt.emit(amplitude_m_s2, _frequency_hz)
	var share := clampf(amplitude_m_s2 / full_m_s2, 0.0, 1.0)
	if controller != null and (share > 0.0 or _is_on):  # a pulse of nothing ends the one that runs
		controller.trigger_haptic_pulse(action, _frequency_hz, share, _PULSE_S, 0.0)
	if vibrates_phone and share > 0.0 and _phone_s <= 0.0:
		if Engine.get_version_info().hex >= 0x040300:  # before, phones have no amplitudes
			Input.call(&"vibrate_handheld", _PHONE_PULSE_MS, share)
		else:
			Input.vibrate_handheld(_PHONE_PULSE_MS)
		_phone_s = _PHONE_S
	if clip != null and not clip.get_columns().is_empty():
		values_changed.emit(_values(amplitude_m_s2))
	_is_on = share > 0.0


## All columns of the clip: those of the chosen actuators play, the others are neutral.
func _values(amplitude_m_s2: float) -> PackedFloat32Array:
	var values := clip.get_neutral_values()
	var columns := clip.get_columns()
	var actuators := clip.get_actuators()
	for index in clip.find_devices(device):
		var each := clip.get_devices()[index]
		for k in range(each.first_actuator, mini(each.first_actuator + each.actuators, actuators.size())):
			var played := actuators[k]
			if played.modality != "vibration" or (actuator != "" and played.id != actuator):
				continue
			var first: int = played.first_column
			var wanted := [amplitude_m_s2, _frequency_hz]
			for column in range(first, first + mini(played.columns, 2 if amplitude_m_s2 > 0.0 else 0)):
				values[column] = clampf(
					wanted[column - first], columns[column].lowest, columns[column].highest
				)
	return values
