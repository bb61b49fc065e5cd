# SPDX-License-Identifier: MIT
class_name HapticBody
extends HapticSource
## Lets an avatar feel [HapticVolume] nodes and painted areas of a clip, on its own moving skeleton.
##
## The skeleton's rest pose has to be that of the body in the clip. Needs the compiled part of the
## add-on (bin/); without it nothing is felt, and the log says so. Values are sent each frame.

## Blender's axes, the clip's, to Godot's: (x, z, -y).
const TO_GODOT := Transform3D(Basis(Vector3.RIGHT, Vector3.FORWARD, Vector3.UP), Vector3.ZERO)

@export var skeleton: Skeleton3D
## The body of the clip; empty: its first.
@export var body := ""

var _core: RefCounted
var _bones: Array[Dictionary] = []  # of the clip
var _numbers := PackedInt32Array()  # of the skeleton's bones; -1: as its parent
var _from_rest: Array[Transform3D] = []
var _effects: Array[Dictionary] = []


func _init() -> void:
	process_priority = 1000  # when the skeleton has been moved


func _ready() -> void:
	super()
	var error := _open()
	if error != "":
		_core = null
		push_error("HapticBody '%s': %s" % [name, error])


func _process(delta: float) -> void:
	if _core == null or not _has_focus:
		return
	_core.set_bones(_matrices())
	_place_volumes()
	values_changed.emit(_core.evaluate(delta))


func stop() -> void:
	_core = null
	super()


## Turns a painted area on at a level of 0 (off) to 1.
func trigger(effect: String, level := 1.0) -> void:
	for k in _effects.size():
		if _core != null and _effects[k].name == effect:
			_core.trigger(k, level)


## What each vertex of the model of an effect (its number in the clip) feels of it, 0 to 1.
func get_weights(effect: int) -> PackedFloat32Array:
	return _core.get_weights(effect) if _core != null else PackedFloat32Array()


## Level of an effect, with its response to the touch, 0 to 1.
func get_level(effect: int) -> float:
	return _core.get_level(effect) if _core != null else 0.0


## A transform as 3 x 4 numbers, row after row.
static func rows_of(transform: Transform3D) -> PackedFloat32Array:
	var x := transform.basis.x
	var y := transform.basis.y
	var z := transform.basis.z
	var at := transform.origin
	return PackedFloat32Array(
		[x.x, y.x, z.x, at.x, x.y, y.y, z.y, at.y, x.z, y.z, z.z, at.z]
	)


func _open() -> String:
	if clip == null or skeleton == null:
		return "choose a clip and a skeleton."
	var bodies := clip.get_bodies()
	if bodies.is_empty():
		return "the clip has no spatial part."
	var names := bodies.map(func(each: Dictionary) -> String: return each.name)
	var number := 0 if body == "" else names.find(body)
	if number < 0:
		return "the clip has no body '%s', but: %s." % [body, ", ".join(names)]
	if not ClassDB.class_exists(&"HapticBodyCore"):
		return "the compiled part of the add-on is not there (python players/native/build.py)."
	_core = ClassDB.instantiate(&"HapticBodyCore")
	var error: int = _core.open(clip.bytes, number)
	if error != 0:
		return "the core refuses the clip (%d); 'hfx validate' says why." % error
	_bones = bodies[number].bones
	_effects = clip.get_effects()
	_find_bones()
	return "" if _numbers.count(-1) < _numbers.size() else "no bone of the skeleton has a known name."


func _find_bones() -> void:
	_numbers.clear()
	_from_rest.clear()
	for bone in _bones:
		var human: String = bone.human
		var names: Array[String] = [
			bone.name, human.left(1).to_upper() + human.substr(1), human,
			bone.mixamo, "mixamorig:" + bone.mixamo, "mixamorig_" + bone.mixamo, bone.unreal,
		]
		var found := -1
		for each in names:
			if found < 0 and each != "":
				found = skeleton.find_bone(each)
		_numbers.append(found)
		_from_rest.append(
			skeleton.get_bone_global_rest(found).affine_inverse() * TO_GODOT
			if found >= 0 else Transform3D.IDENTITY
		)


## For each bone of the clip: the clip's rest space to Godot's world.
func _matrices() -> PackedFloat32Array:
	var placed: Array[Transform3D] = []
	var rows := PackedFloat32Array()
	for k in _bones.size():
		var parent: int = _bones[k].parent
		if _numbers[k] >= 0:
			var pose := skeleton.get_bone_global_pose(_numbers[k])
			placed.append(skeleton.global_transform * pose * _from_rest[k])
		else:
			placed.append(placed[parent] if parent >= 0 else skeleton.global_transform * TO_GODOT)
		rows.append_array(rows_of(placed[k]))
	return rows


## Volumes of which there is no node, or none that is visible, are off.
func _place_volumes() -> void:
	var there := {}
	for volume: HapticVolume in get_tree().get_nodes_in_group(HapticVolume.GROUP):
		if volume.is_visible_in_tree():
			there[volume.effect] = volume
	for k in _effects.size():
		if _effects[k].is_painted:
			continue
		var volume: HapticVolume = there.get(_effects[k].name)
		_core.trigger(k, volume.level if volume != null else 0.0)
		if volume != null:
			_core.set_volume(k, rows_of(volume.global_transform * TO_GODOT))
