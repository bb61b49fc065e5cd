# SPDX-License-Identifier: MIT
extends Node3D
## Plays a clip on the controllers of an OpenXR runtime and writes what it asks for to plan.csv in
## the folder OUT, to be compared with the runtime's own log of its calls. Ends with 0 once the
## clip is over, 3 without OpenXR, 4 without controllers.

var _waited := 0.0
var _has_focus := false
var _plan: FileAccess


func _ready() -> void:
	var runtime := XRServer.find_interface("OpenXR")
	if runtime == null or not runtime.is_initialized():
		return get_tree().quit(3)
	runtime.session_focussed.connect(func(): _has_focus = true)
	get_viewport().use_xr = true
	DisplayServer.window_set_vsync_mode(DisplayServer.VSYNC_DISABLED)
	_plan = FileAccess.open(OS.get_environment("OUT").path_join("plan.csv"), FileAccess.WRITE)
	_plan.store_line("left,left_hz,right,right_hz")
	$Player.clip = HapticClip.from_bytes(FileAccess.get_file_as_bytes(OS.get_cmdline_user_args()[0]))
	$Player.values_changed.connect(_write)
	$Player.finished.connect(_end)


func _process(delta: float) -> void:
	_waited += delta
	if $Player.is_playing() or _plan == null:
		return
	if _has_focus and $Origin/Left.get_has_tracking_data() and $Origin/Right.get_has_tracking_data():
		$Player.play()
	elif _waited > 30.0:
		get_tree().quit(4)


func _write(values: PackedFloat32Array) -> void:
	_plan.store_csv_line(Array(values).map(func(each): return "%.9f" % each))


func _end() -> void:
	set_process(false)
	await get_tree().create_timer(0.3).timeout
	_plan.close()
	get_tree().quit(0)
