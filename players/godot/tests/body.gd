# SPDX-License-Identifier: MIT
extends SceneTree
## Lets a skeleton walk as players/conformance/spatial says and compares each weight: godot
## --headless --script tests/body.gd -- FOLDER. Ends with 1 if one is wrong.

var _wrong := 0
var _felt := 0
var _body := HapticBody.new()
var _rest: Array[Transform3D] = []
var _volumes: Array[HapticVolume] = []


func _init() -> void:
	_run.call_deferred(OS.get_cmdline_user_args()[0])


func _run(folder: String) -> void:
	_body.clip = HapticClip.from_bytes(FileAccess.get_file_as_bytes(folder.path_join("walk.hfxclip")))
	_body.skeleton = _skeleton()
	for effect in _body.clip.get_effects():
		_volumes.append(HapticVolume.new())
		_volumes[-1].effect = effect.name
		root.add_child(_volumes[-1])
	root.add_child(_body.skeleton)
	root.add_child(_body)
	for line in FileAccess.get_file_as_string(folder.path_join("walk.txt")).split("\n", false):
		var words := line.split(" ")
		match words[0]:
			"bone":
				_pose(int(words[1]), _placed(words, 2))
			"volume":
				_volumes[int(words[1])].level = float(words[2])
				_volumes[int(words[1])].global_transform = _placed(words, 3)
			"evaluate":
				_body._process(float(words[1]))
			"felt":
				_compare(words)
	print("%d weights felt, %d wrong" % [_felt, _wrong])
	quit(1 if _wrong > 0 or _felt == 0 else 0)


## Bones with axes of their own, as any engine's; a bone without a parent, so that each is posed alone.
func _skeleton() -> Skeleton3D:
	var skeleton := Skeleton3D.new()
	var random := RandomNumberGenerator.new()
	random.seed = 3
	for bone in _body.clip.get_bodies()[0].bones:
		var turned := Basis.from_euler(Vector3(random.randf(), random.randf(), random.randf()) * 6.0)
		_rest.append(Transform3D(turned, Vector3(random.randf(), random.randf(), random.randf())))
		skeleton.add_bone(bone.name)
		skeleton.set_bone_rest(skeleton.get_bone_count() - 1, _rest[-1])
	return skeleton


func _pose(bone: int, moved: Transform3D) -> void:
	_body.skeleton.set_bone_pose(bone, moved * _rest[bone])


## A matrix of the clip's space in Godot's: (x, z, -y).
func _placed(words: PackedStringArray, at: int) -> Transform3D:
	var n: Array[float] = []
	for k in 12:
		n.append(float(words[at + k]))
	var clip := Transform3D(
		Vector3(n[0], n[4], n[8]), Vector3(n[1], n[5], n[9]), Vector3(n[2], n[6], n[10]),
		Vector3(n[3], n[7], n[11])
	)
	var turned := Transform3D(Basis(Vector3(1, 0, 0), Vector3(0, 0, -1), Vector3(0, 1, 0)), Vector3())
	return turned * clip * turned.affine_inverse()


func _compare(words: PackedStringArray) -> void:
	var found := _body.get_weights(int(words[1]))
	var level := _body.get_level(int(words[1]))
	var expected := PackedFloat32Array()
	expected.resize(found.size())
	for word in words.slice(2):
		expected[int(word.get_slice(":", 0))] = float(word.get_slice(":", 1))
	for k in found.size():
		_felt += int(found[k] * level > 0.0 or expected[k] > 0.0)
		if absf(found[k] * level - expected[k]) > 1.0 / 255.0:
			_wrong += 1
			if _wrong < 6:
				print("effect %s, vertex %d: %f instead of %f" % [words[1], k, found[k] * level, expected[k]])
