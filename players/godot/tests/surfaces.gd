# SPDX-License-Identifier: MIT
extends SceneTree
## Plays players/conformance/surfaces and moves a pointer, a hit on a plane and a lost focus:
## godot --headless --script tests/surfaces.gd -- FOLDER. Ends with 1 if a result differs.

const FRAME_S := 0.01

var _wrong := 0
var _compared := 0
var _felt := []


func _init() -> void:
	_run.call_deferred(OS.get_cmdline_user_args()[0])


func _run(folder: String) -> void:
	var clip := HapticClip.from_bytes(FileAccess.get_file_as_bytes(folder.path_join("strokes.hfxclip")))
	_strokes(clip, FileAccess.get_file_as_string(folder.path_join("strokes.txt")))
	_pointer(clip)
	_plane(clip)
	await _sample()
	print("%d samples of strokes compared, %d wrong" % [_compared, _wrong])
	quit(1 if _wrong > 0 or _compared == 0 else 0)


func _strokes(clip: HapticClip, calls: String) -> void:
	var node := HapticSurface.new()
	node.clip = clip
	var highest := 0.0
	for line in calls.split("\n", false):
		var words := line.split(" ")
		if words[0] == "surface":
			var found := clip.get_surfaces()[int(words[1])]
			highest = found.highest_m_s2
			node.surface = found.name
			node.release()
			continue
		var actual := node.feel(float(words[1]), float(words[2]), -1.0, float(words[3]))
		_compared += 1
		_check(absf(actual.x - float(words[5])) <= highest / 255.0, line)
		_check(words.size() < 7 or absf(actual.y - float(words[6])) <= 1.0, line)
	node.free()


func _pointer(clip: HapticClip) -> void:
	var node := _added(clip)
	var area := Rect2(100.0, 50.0, 200.0, 100.0)
	var event := InputEventMouseButton.new()
	event.button_index = MOUSE_BUTTON_LEFT
	event.pressed = true
	event.position = Vector2(150.0, 75.0)
	_check(node.touch_event(event, area), "a button in the area touches")
	node._process(FRAME_S)
	_check(_felt == [0.0], "a touch begins silent")
	var motion := InputEventMouseMotion.new()
	motion.button_mask = MOUSE_BUTTON_MASK_LEFT
	motion.position = Vector2(250.0, 75.0)
	_check(node.touch_event(motion, area), "a motion touches")
	node._process(FRAME_S)
	# The same path: from (0.25, 0.75) to (0.75, 0.75), v upwards.
	var other := HapticSurface.new()
	other.clip = clip
	other.feel(0.25, 0.75, -1.0, FRAME_S)
	var expected := other.feel(0.75, 0.75, -1.0, FRAME_S).x
	_check(expected > 0.0 and is_equal_approx(_felt[-1], expected), "a motion is felt: %s" % expected)
	node._process(FRAME_S)
	_check(_felt[-1] > 0.0, "pointers are slower than frames")
	for k in 10:
		node._process(FRAME_S)
	_check(_felt[-1] == 0.0, "a pointer that stands is silent")
	motion.position = Vector2(150.0, 75.0)
	node.touch_event(motion, area)
	node._process(FRAME_S)
	_check(_felt[-1] > 0.0, "and goes on")
	node._set_focus(false)
	_check(_felt[-1] == 0.0, "a lost focus is silent")
	node._set_focus(true)
	node.touch_event(motion, area)
	node._process(FRAME_S)
	motion.position = Vector2(350.0, 75.0)
	_check(not node.touch_event(motion, area), "beyond the area nothing is touched")
	node.queue_free()
	other.free()


func _plane(clip: HapticClip) -> void:
	var node := _added(clip)
	node.repeat = Vector2(2.0, 1.0)
	var plane := MeshInstance3D.new()
	var mesh := QuadMesh.new()
	mesh.size = Vector2(0.4, 0.2)
	plane.mesh = mesh
	root.add_child(plane)
	plane.position = Vector3(1.0, 2.0, 3.0)
	for at in [Vector3(-0.1, -0.05, 0.0), Vector3(0.1, 0.05, 0.0)]:
		node.touch_at(plane.to_global(at), plane)
		node._process(FRAME_S)
	var other := HapticSurface.new()
	other.clip = clip
	other.feel(0.5, 0.25, -1.0, FRAME_S)
	var expected := other.feel(1.5, 0.75, -1.0, FRAME_S).x
	_check(expected > 0.0 and absf(_felt[-1] - expected) < 0.05, "a hit is felt: %s" % [_felt])
	# The materials have no texture coordinates here: as shares of the map, repeated.
	node.release()
	for at in [Vector2(0.25, 0.25), Vector2(0.75, 0.75)]:
		node.touch_texture(at)
		node._process(FRAME_S)
	_check(absf(_felt[-1] - expected) < 0.05, "texture coordinates are felt: %s" % [_felt])
	node.release()
	_check(_felt[-1] == 0.0, "released")
	node.free()
	other.free()


## A drag over each square of the sample's board.
func _sample() -> void:
	var board: Control = load("res://board/board.tscn").instantiate()
	root.add_child(board)
	board.set_anchors_preset(Control.PRESET_TOP_LEFT)
	board.size = Vector2(800.0, 800.0)
	var surface: HapticSurface = board.get_node("Surface")
	surface.set_process(false)
	_felt.clear()
	surface.felt.connect(func(amplitude: float, _hz: float) -> void: _felt.append(amplitude))
	var motion := InputEventMouseMotion.new()
	motion.button_mask = MOUSE_BUTTON_MASK_LEFT
	var sent := []
	surface.values_changed.connect(func(values: PackedFloat32Array) -> void: sent.append(values))
	var column := surface.clip.get_columns()[0]
	var names := {}
	for row in 4:
		for at in 4:
			for share in [0.2, 0.5, 0.8]:
				motion.position = 200.0 * Vector2(at + share, row + share)
				board._input(motion)
				surface._process(FRAME_S)
			_check(_felt[-1] > 0.0, "square %d %d is felt" % [row, at])
			_check(surface.surface.ends_with("%d%d" % [row + 1, at + 1]), surface.surface)
			var expected := minf(_felt[-1], column.highest)
			_check(is_equal_approx(sent[-1][0], expected), "a device plays it: %s" % [sent[-1]])
			names[surface.surface] = true
	_check(names.size() == 16, "all squares")
	board.queue_free()
	await process_frame


func _added(clip: HapticClip) -> HapticSurface:
	_felt.clear()
	var node := HapticSurface.new()
	node.clip = clip
	node.felt.connect(func(amplitude: float, _hz: float) -> void: _felt.append(amplitude))
	root.add_child(node)
	node.set_process(false)
	return node


func _check(holds: bool, fault: String) -> void:
	if holds:
		return
	_wrong += 1
	if _wrong < 10:
		print("wrong: ", fault)
