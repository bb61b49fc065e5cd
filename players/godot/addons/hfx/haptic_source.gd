# SPDX-License-Identifier: MIT
@tool
class_name HapticSource
extends Node
## What [HapticPlayer] and [HapticBody] have in common: values of all columns of a [HapticClip].
##
## An output (say [HapticControllers]) takes the values from [signal values_changed]. While nothing
## plays, while the game is paused, and when the window or the headset loses its focus, all values
## are neutral.

## All columns of the clip, in their units.
signal values_changed(values: PackedFloat32Array)

@export var clip: HapticClip:
	set(value):
		if clip != null:
			_forget()
		clip = value
		update_configuration_warnings()
		notify_property_list_changed()  # names in the clip, and buttons in the inspector
## Silent while the window or the headset is in the background.
@export var silent_without_focus := true

var _has_focus := true


func _ready() -> void:
	if Engine.is_editor_hint():
		return
	var headset := XRServer.find_interface("OpenXR")
	if headset != null and headset.is_initialized():
		headset.session_focussed.connect(_set_focus.bind(true))
		headset.session_visible.connect(_set_focus.bind(false))
		headset.session_stopping.connect(_set_focus.bind(false))


func _notification(what: int) -> void:
	if Engine.is_editor_hint():
		return
	match what:
		NOTIFICATION_APPLICATION_FOCUS_OUT, NOTIFICATION_APPLICATION_PAUSED:
			if not is_inside_tree() or not get_viewport().use_xr:  # a headset has a focus of its own
				_set_focus(false)
		NOTIFICATION_APPLICATION_FOCUS_IN, NOTIFICATION_APPLICATION_RESUMED:
			_set_focus(true)
		NOTIFICATION_PAUSED, NOTIFICATION_DISABLED, NOTIFICATION_EXIT_TREE:
			_silence()


func _get_configuration_warnings() -> PackedStringArray:
	return [] if clip != null else ["Choose a clip."]


## Ends in silence.
func stop() -> void:
	_silence()


## The clip is about to change.
func _forget() -> void:
	stop()


func _set_focus(has_focus: bool) -> void:
	_has_focus = has_focus or not silent_without_focus
	if not _has_focus:
		_silence()


func _silence() -> void:
	if clip != null:
		values_changed.emit(clip.get_neutral_values())
