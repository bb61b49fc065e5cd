# SPDX-License-Identifier: MIT
extends SceneTree
## Checks HapticBody in a running scene: drawn poses, authored levels, several volumes, changes of the
## tree, messages. godot --headless --script tests/avatar.gd -- FOLDER, of players/conformance/spatial.
## Ends with 1 if a check fails.

const HapticVolumes := preload("res://addons/hfx/haptic_volumes.gd")
const FAR := Vector3(100.0, 0.0, 0.0)
const LEVEL := 0.7489338  # of "Volume 0" in the clip: 12 m/s^2 without contact response

var _failed := 0
var _checks := 0
var _clip: HapticClip
var _values := PackedFloat32Array()
var _count := 0


class Lift:
	extends SkeletonModifier3D
	## Moves all bones without a parent.

	func _process_modification() -> void:
		for bone in get_skeleton().get_parentless_bones():
			get_skeleton().set_bone_pose_position(bone, FAR)


func _init() -> void:
	_run.call_deferred(OS.get_cmdline_user_args()[0])


func _run(folder: String) -> void:
	_clip = HapticClip.from_bytes(FileAccess.get_file_as_bytes(folder.path_join("walk.hfxclip")))
	await _check_modifiers()
	await _check_volumes()
	await _check_tree()
	_check_bones()
	_check_created()
	await _check_library(folder)
	_check_instance()
	_check_following(folder)
	_check_checksum()
	print("%d checks, %d failed" % [_checks, _failed])
	quit(1 if _failed > 0 else 0)


func _check_modifiers() -> void:
	var skeleton := _skeleton()
	var body := _body(skeleton)
	var volume := _volume(Vector3.ZERO)
	await _frames(3)
	_is("felt at rest", _values[0] > 8.0, true)
	var lift := Lift.new()
	skeleton.add_child(lift)
	await _frames(3)
	_is("a modifier has moved the body away", _values[0], 0.0)
	volume.position = FAR
	await _frames(3)
	_is("felt where it is drawn", _values[0] > 8.0, true)
	_count = 0
	await _frames(5)
	_is("values once a frame", _count, 6)
	lift.active = false
	await _frames(3)
	_is("the modifier is off", _values[0], 0.0)
	for bone in skeleton.get_parentless_bones():
		skeleton.set_bone_pose_position(bone, FAR)
	await _frames(2)
	_is("felt without a modifier", _values[0] > 8.0, true)
	var attachment := BoneAttachment3D.new()
	skeleton.add_child(attachment)
	attachment.bone_idx = 0
	volume.reparent(attachment, false)
	volume.position = Vector3.ZERO
	await _frames(3)
	for bone in skeleton.get_parentless_bones():
		skeleton.set_bone_pose_position(bone, -FAR)
	await process_frame
	_is("a volume on a bone is where it is drawn", _values[0] > 8.0, true)
	_free([body, skeleton])


## Effects of another clip: the same ones, by name, on the body and the devices of the first.
func _check_library(folder: String) -> void:
	var skeleton := _skeleton()
	var body := _body(skeleton)
	var volume := _volume(Vector3.ZERO)
	await _frames(2)
	var alone := _values[0]
	body.effects = HapticClip.from_bytes(FileAccess.get_file_as_bytes(folder.path_join("walk.hfxclip")))
	await _frames(2)
	_near("effects of a library", _values[0], alone)
	_is("and only these", body.get_effect_clip() == body.effects, true)
	var library := folder.path_join("../behaviour/library.hfxclip")
	body.effects = HapticClip.from_bytes(FileAccess.get_file_as_bytes(library))
	await _frames(2)
	_is("a library without the volume", _values[0], 0.0)
	var warnings := body._get_configuration_warnings()
	_is("effects without skin are named", warnings.size() == 1 and "feel Heat:" in warnings[0], true)
	volume.effect = "Ball"
	body.trigger("Dot")
	body.place("Dot", 90.0)
	await _frames(2)
	_is("names are those of the library", body.get_effect_clip().get_effects()[1].name, "Ball")
	body.effects = null
	volume.effect = "Volume 0"
	await _frames(2)
	_near("the clip's own again", _values[0], alone)
	volume.free()
	_free([body, skeleton])


func _check_volumes() -> void:
	var skeleton := _skeleton()
	var body := _body(skeleton)
	var volume := _volume(Vector3.ZERO)
	await _frames(2)
	_near("authored level", body.get_level(0), LEVEL)
	volume.level = 0.5
	await _frames(2)
	_near("half of it", body.get_level(0), 0.5 * LEVEL)
	volume.level = 1.0
	var far := _volume(FAR)
	await _frames(2)
	_is("another volume far away takes nothing", _values[0] > 8.0, true)
	far.position = Vector3.ZERO
	far.level = 0.05
	await _frames(2)
	_near("two add up", _values[0], 1.05 * 12.0 * LEVEL)
	volume.hide()
	await _frames(2)
	_near("one is hidden", _values[0], 0.05 * 12.0 * LEVEL)
	volume.free()
	await _frames(2)
	_near("and gone", _values[0], 0.05 * 12.0 * LEVEL)
	far.effect = "Volume 1"
	await _frames(2)
	_near("of another effect", body.get_level(0), 0.0)
	far.free()
	await _frames(2)
	_near("none is left", _values[0], 0.0)
	_free([body, skeleton])


func _check_tree() -> void:
	var skeleton := _skeleton()
	var body := _body(skeleton)
	var volume := _volume(Vector3.ZERO)
	var other := Node3D.new()
	root.add_child(other)
	await _frames(2)
	body.reparent(other)
	await _frames(2)
	_is("moved in the tree", _values[0] > 8.0, true)
	other.remove_child(body)
	_is("silent out of the tree", _values[0], 0.0)
	root.add_child(body)
	await _frames(2)
	_is("removed and added", _values[0] > 8.0, true)
	body.clip = _clip.duplicate()
	await _frames(2)
	_is("another clip", _values[0] > 8.0, true)
	skeleton.free()
	_is("silent without a skeleton", _values[0], 0.0)
	await _frames(2)
	_is("it says so", body._get_configuration_warnings().size(), 1)
	body.skeleton = _skeleton()
	await _frames(2)
	_is("another skeleton", _values[0] > 8.0, true)
	_is("and nothing is missing", body._get_configuration_warnings().size(), 0)
	body.stop()
	await _frames(2)
	_is("stopped", _values[0], 0.0)
	body.start()
	await _frames(2)
	_is("started", _values[0] > 8.0, true)
	var late := HapticBody.new()
	root.add_child(late)
	await _frames(2)
	late.values_changed.connect(_take)
	late.skeleton = body.skeleton
	body.free()
	late.clip = _clip
	_values.clear()
	await _frames(2)
	_is("set up after it was added", _values.size() > 0 and _values[0] > 8.0, true)
	late.body = "Nobody"
	await _frames(2)
	_is("an unknown body is silent", _values[0], 0.0)
	_is("and named", "Nobody" in late._get_configuration_warnings()[0], true)
	_free([late, volume, late.skeleton])


func _check_bones() -> void:
	var bones: Array = _clip.get_bodies()[0].bones
	var skeleton := Skeleton3D.new()
	for name in ["mixamorig_Hips", "mixamorig_Spine", "mixamorig_LeftHand", "mixamorig_Head"]:
		skeleton.add_bone(name)
	root.add_child(skeleton)
	var body := _body(skeleton)
	var warnings := body._get_configuration_warnings()
	_is("a skeleton in part is accepted", body.advance(0.0).size(), _clip.get_columns().size())
	_is("with a warning", warnings.size() == 1 and "are not in" in warnings[0], true)
	var strange := Skeleton3D.new()
	strange.add_bone("Wheel")
	root.add_child(strange)
	body.skeleton = strange
	_is("no known bone", "known name" in body._get_configuration_warnings()[0], true)
	_is("bones of the clip", bones.size(), 124)
	_free([body, skeleton, strange])


## An avatar that is an instanced scene: its skeleton cannot be chosen in the editor, and nodes inside
## are saved only if its children are editable.
func _check_instance() -> void:
	var avatar := Node3D.new()
	var inner := Skeleton3D.new()
	inner.add_bone("Volume 5")
	avatar.add_child(inner)
	inner.owner = avatar
	var packed := PackedScene.new()
	packed.pack(avatar)
	avatar.free()
	avatar = packed.instantiate()
	inner = avatar.get_child(0)
	var scene := Node3D.new()
	scene.add_child(avatar)
	avatar.owner = scene
	root.add_child(scene)
	var body := HapticBody.new()
	avatar.add_child(body)
	_is("the skeleton below the parent", body.skeleton, inner)
	var created := HapticVolumes.create(_clip, scene, body.skeleton)
	_is("in the instance", created[5].instances, [avatar] as Array[Node])
	_is("not in an instance", created[0].instances.size(), 0)
	for each: Dictionary in created:
		each.node.free()
	scene.free()


func _check_created() -> void:
	var scene := Node3D.new()
	root.add_child(scene)
	scene.position = Vector3(1.0, 2.0, 3.0)
	var door := Node3D.new()
	door.name = "volume 3"
	scene.add_child(door)
	door.scale = Vector3.ONE * 2.0
	var skeleton := Skeleton3D.new()
	skeleton.name = "Bones"
	skeleton.add_bone("Volume 5")
	skeleton.set_bone_pose_position(0, Vector3.UP)
	scene.add_child(skeleton)
	var created := HapticVolumes.create(_clip, scene, skeleton)
	_is("a volume for each effect", created.size(), 8)
	for each in created:
		each.parent.add_child(each.node)
	_is("none twice", HapticVolumes.create(_clip, scene, skeleton).size(), 0)
	_is("below the node of its name", created[3].node.get_parent(), door)
	_is("on the bone of its name", created[5].node is BoneAttachment3D, true)
	_is("below the scene", created[0].node.get_parent(), scene)
	# Blender's (x, y, z) is (x, z, -y) here: rows 0, 2 and minus 1 of the last column of its matrix.
	var at := 0
	for k in _clip.get_effects().size():
		at = _clip._at("EFCT", k) + 76
		var place := Vector3(
			_clip.bytes.decode_float(at + 12), _clip.bytes.decode_float(at + 44),
			-_clip.bytes.decode_float(at + 28)
		)
		var node: Node3D = created[k].owned[-1]
		_is("shape of %d" % k, node.shape, _clip.get_effects()[k].shape)
		if k != 5:  # an attachment moves when the skeleton is next updated
			_is("place of %d" % k, node.global_position.distance_to(place) < 1e-4, true)
			# Its length along Blender's Z, here Y, is that of the third column of its matrix.
			var z := Vector3(
				_clip.bytes.decode_float(at + 8), _clip.bytes.decode_float(at + 24),
				_clip.bytes.decode_float(at + 40)
			)
			_is("size of %d" % k, absf(node.global_basis.y.length() - z.length()) < 1e-4, true)
	scene.free()


## Ten rows of 0.1 s, row i of the left pad is i + 1; Strike is 0.2 to 0.5 s.
func _check_following(folder: String) -> void:
	var player := HapticPlayer.new()
	var bytes := FileAccess.get_file_as_bytes(folder.path_join("../behaviour/behaviour.hfxclip"))
	player.clip = HapticClip.from_bytes(bytes)
	player.values_changed.connect(_take)
	root.add_child(player)
	player.speed = 0.5
	player.play()
	player._process(0.0)
	player._process(0.4)
	_near("at half the speed", _values[0], 3.0)
	player.speed = 1.0
	var library := AnimationLibrary.new()
	for name in ["Walk", "Strike"]:
		library.add_animation(name, Animation.new())
		library.get_animation(name).length = 1.0 if name == "Walk" else 0.3
	library.get_animation("Walk").loop_mode = Animation.LOOP_LINEAR
	var animations := AnimationPlayer.new()
	animations.callback_mode_process = AnimationMixer.ANIMATION_CALLBACK_MODE_PROCESS_MANUAL
	animations.add_animation_library("", library)
	root.add_child(animations)
	player.follow = animations
	player._process(0.1)
	player.stop()
	animations.play("Walk")
	for step in [[0.35, 4.0], [0.1, 5.0], [0.5, 10.0], [0.2, 2.0]]:
		animations.advance(step[0])
		player._process(0.016)
		_near("in step with the animation", _values[0], step[1])
	_near("it has begun again", player.get_playback_position(), 0.15)
	animations.seek(0.75, true)
	player._process(0.016)
	_near("after a jump", _values[0], 8.0)
	animations.play("Strike")
	animations.advance(0.1)
	player._process(0.016)
	_near("the named clip of the animation's name", _values[0], 4.0)
	animations.stop()
	player._process(0.016)
	_near("stopped with it", _values[0], 0.0)
	player.free()
	animations.free()


func _check_checksum() -> void:
	var bytes := _clip.bytes.duplicate()
	for place in [20, 30, 70000, bytes.size() - 1]:
		bytes[place] ^= 1
		var damaged := HapticClip.new()
		damaged.bytes = bytes
		_is("damage at %d" % place, damaged.fault() != "", true)
		bytes[place] ^= 1
	var large := bytes.duplicate()
	large.resize(687_000)
	large.encode_u32(12, large.size())
	var start := Time.get_ticks_usec()
	var times := 0
	for k in 10:
		HapticClip._is_checksum(large.slice(20), 0)
		times += 1
	print("checksum of 687 kB: %.1f ms" % ((Time.get_ticks_usec() - start) / 1000.0 / times))


func _skeleton() -> Skeleton3D:
	var skeleton := Skeleton3D.new()
	for bone: Dictionary in _clip.get_bodies()[0].bones:
		var number := skeleton.add_bone(bone.name)
		if bone.parent >= 0:
			skeleton.set_bone_parent(number, bone.parent)
	root.add_child(skeleton)
	return skeleton


func _body(skeleton: Skeleton3D) -> HapticBody:
	var body := HapticBody.new()
	body.clip = _clip
	body.skeleton = skeleton
	body.values_changed.connect(_take)
	root.add_child(body)
	return body


func _volume(at: Vector3) -> HapticVolume:
	var volume := HapticVolume.new()
	volume.effect = "Volume 0"
	volume.position = at
	volume.scale = Vector3.ONE * 20.0
	root.add_child(volume)
	return volume


func _take(values: PackedFloat32Array) -> void:
	_values = values
	_count += 1


func _frames(count: int) -> void:
	for k in count:
		await process_frame
	await process_frame  # of what was deferred


func _free(nodes: Array) -> void:
	for node in nodes:
		if is_instance_valid(node):
			node.queue_free()
	for node in get_nodes_in_group(HapticVolume.GROUP):
		node.queue_free()


func _near(text: String, found: float, expected: float) -> void:
	_is(text, absf(found - expected) < 1e-3, true)
	if absf(found - expected) >= 1e-3:
		print("  %f instead of %f" % [found, expected])


func _is(text: String, found: Variant, expected: Variant) -> void:
	_checks += 1
	if found != expected:
		_failed += 1
		print("FAILED: %s: %s instead of %s" % [text, found, expected])
