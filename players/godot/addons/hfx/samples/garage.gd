# SPDX-License-Identifier: MIT
extends Node3D
## Garage of HFX's demo: plays its clip on the controllers of a headset or on a gamepad, and shows each
## actuator as a bar. Space, A of the gamepad, or the trigger of a controller begins again.

const COLOURS := {
	"vibration": Color(0.85, 0.2, 0.2),
	"pressure": Color(0.2, 0.7, 0.3),
	"temperature": Color(0.95, 0.6, 0.15),
	"wind": Color(0.2, 0.7, 0.85),
}
const WIDTH_M := 0.06
const HEIGHT_M := 0.8

var _bars: Array[MeshInstance3D] = []


func _ready() -> void:
	var runtime := XRServer.find_interface("OpenXR")
	get_viewport().use_xr = runtime != null and runtime.is_initialized()
	$Player.values_changed.connect(_show)
	$Player.finished.connect(func(): $Label.text = "Space, A or trigger: again")
	for controller in [$Origin/Left, $Origin/Right]:
		controller.button_pressed.connect(_again)
	_build_bars()
	_begin()


func _unhandled_input(event: InputEvent) -> void:
	if event.is_action_pressed("ui_accept"):
		_begin()


func _process(_delta: float) -> void:
	if $Player.is_playing():
		$Label.text = "HFX garage   %.1f s" % $Player.get_playback_position()


func _again(button: String) -> void:
	if button == "trigger_click":
		_begin()


func _begin() -> void:
	$Player.play()


func _build_bars() -> void:
	var actuators: Array[Dictionary] = $Player.clip.get_actuators()
	for k in actuators.size():
		var bar := MeshInstance3D.new()
		bar.mesh = BoxMesh.new()
		var paint := StandardMaterial3D.new()
		paint.albedo_color = COLOURS[actuators[k].modality]
		bar.material_override = paint
		bar.position.x = (k - 0.5 * (actuators.size() - 1)) * 1.6 * WIDTH_M
		$Bars.add_child(bar)
		_bars.append(bar)
	_show($Player.clip.get_neutral_values())


func _show(values: PackedFloat32Array) -> void:
	var columns: Array[Dictionary] = $Player.clip.get_columns()
	var actuators: Array[Dictionary] = $Player.clip.get_actuators()
	for k in _bars.size():
		var column: Dictionary = columns[actuators[k].first_column]
		var away: float = values[actuators[k].first_column] - column.neutral
		var most: float = maxf(column.highest - column.neutral, column.neutral - column.lowest)
		var height := maxf(HEIGHT_M * absf(away) / most, 0.005)
		_bars[k].scale = Vector3(WIDTH_M, height, WIDTH_M)
		_bars[k].position.y = 0.5 * height
