# SPDX-License-Identifier: MIT
extends Control
## The map paper's board of 4 x 4 squares of four materials: drag over it with a mouse, or with a
## finger on a phone, which vibrates.

const COLOURS := {
	"Gravel": Color(0.45, 0.43, 0.4),
	"Metal": Color(0.6, 0.65, 0.7),
	"Fabric": Color(0.3, 0.35, 0.6),
	"Wood": Color(0.6, 0.42, 0.25),
}
const COUNT := 4

var _squares: Array[ColorRect] = []
var _repeats: Array[Vector2] = []  # of the maps on the squares, to scale


func _ready() -> void:
	for found in $Surface.clip.get_surfaces():
		var square := ColorRect.new()
		square.name = found.name
		square.color = COLOURS[found.name.get_slice(" ", 0)]
		square.mouse_filter = MOUSE_FILTER_IGNORE
		add_child(square)
		_squares.append(square)
		_repeats.append(
			Vector2(found.uv_width_mm / found.width_mm, found.uv_height_mm / found.height_mm)
		)
	resized.connect(_arrange)
	_arrange()
	$Surface.felt.connect(_show)
	move_child($Label, -1)


func _input(event: InputEvent) -> void:
	if not (event is InputEventMouse or event is InputEventScreenTouch or event is InputEventScreenDrag):
		return
	for k in _squares.size():
		var area := _squares[k].get_global_rect()
		if area.has_point(event.position):
			$Surface.surface = _squares[k].name
			$Surface.repeat = _repeats[k]
			$Surface.touch_event(event, area)
			return
	$Surface.release()


## A name ends with row and column, counted from 1.
func _arrange() -> void:
	var side := minf(size.x, size.y) / COUNT
	for square in _squares:
		var place := square.name.get_slice(" ", 1)
		square.position = side * Vector2(int(place[1]) - 1, int(place[0]) - 1)
		square.size = (side - 2.0) * Vector2.ONE


func _show(amplitude_m_s2: float, frequency_hz: float) -> void:
	$Label.text = "%s: %.1f m/s², %.0f Hz" % [$Surface.surface, amplitude_m_s2, frequency_hz]
