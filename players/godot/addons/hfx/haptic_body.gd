# SPDX-License-Identifier: MIT
@tool
class_name HapticBody
extends HapticSource
## Lets an avatar feel [HapticVolume] nodes and painted areas of a clip, on its own moving skeleton.
##
## It feels the pose that is drawn, after all [SkeletonModifier3D] nodes (inverse kinematics, tracked
## hands). The skeleton's rest pose has to be that of the body in the clip. Clip, skeleton and body
## may be set or changed at any time, and the node may be moved in the tree. Needs the compiled part
## of the add-on (bin/). What is missing is said by a warning of the node and, once, in the log;
## nothing is felt until then. Values are sent each frame.

const HapticBones := preload("haptic_bones.gd")
## Blender's axes, the clip's, to Godot's: (x, z, -y).
const TO_GODOT := Transform3D(Basis(Vector3.RIGHT, Vector3.FORWARD, Vector3.UP), Vector3.ZERO)
const _NAMES := 12  # of missing bones in a message

## The clip whose volumes and painted areas are felt, on the body of [member clip] and with its devices:
## a library for all avatars. Empty: those of [member clip].
@export var effects: HapticClip:
	set(value):
		_forget()
		effects = value
		notify_property_list_changed()
## Skeleton of the avatar. A new node takes the parent, or the first skeleton below the parent.
@export var skeleton: Skeleton3D:
	set(value):
		_forget()
		skeleton = value
## The body of the clip; empty: its first.
@export var body := "":
	set(value):
		_forget()
		body = value

var _core: RefCounted  # null: not open
var _is_stopped := false
var _bones: Array = []  # of the clip
var _numbers := PackedInt32Array()  # of the skeleton's bones; -1: as its parent
var _from_rest: Array[Transform3D] = []
var _drawn: Array[Transform3D] = []  # poses after modifiers, in the skeleton's space
var _effects: Array[Dictionary] = []
var _effect_numbers := {}  # name of a volume effect: its number
var _levels := {}  # name of a painted area: its level
var _places := {}  # name of a painted area: degrees, metres, stretch
var _volumes := {}  # id of a HapticVolume node: number in the core, effect, frame, is late
var _frame := 0
var _said := {}  # messages in the log


func _init() -> void:
	process_priority = 1000  # when the skeleton has been moved


func _enter_tree() -> void:
	var parent := get_parent()
	if skeleton != null:
		return
	if parent is Skeleton3D:
		skeleton = parent
		return
	for node: Skeleton3D in parent.find_children("*", "Skeleton3D", true, false):
		skeleton = node
		return


func _ready() -> void:
	super()
	if Engine.is_editor_hint():
		set_process(false)
	elif clip != null and is_instance_valid(skeleton):
		_is_open()


func _process(delta: float) -> void:
	if Engine.is_editor_hint() or _is_stopped or not _has_focus or not _is_open():
		return
	if _is_drawn_later():
		_feel.call_deferred(delta)  # behind the skeletons' own updates, which are deferred, too
	else:
		_feel(delta)


func _notification(what: int) -> void:
	if what == NOTIFICATION_EXIT_TREE:
		_close()


func _get_configuration_warnings() -> PackedStringArray:
	var faults := PackedStringArray()
	var core := _core
	var fault := _open()
	if fault == "":
		fault = _missing_bones()
	if fault == "":
		fault = _missing_models()
	if fault != "":
		faults.append(fault)
	if core == null:
		_close()
	return faults


## Evaluates the body [param seconds] after the last time and gives all columns; neutral values where
## something is missing. [method _process] calls it in step with the drawn pose; a game that has a
## clock of its own may do so instead, with the node's processing off.
func advance(seconds: float) -> PackedFloat32Array:
	if not _is_open():
		return clip.get_neutral_values() if clip != null else PackedFloat32Array()
	_core.set_bones(_matrices())
	_place_volumes()
	return _core.evaluate(seconds)


## Ends in silence, until [method start].
func stop() -> void:
	_is_stopped = true
	super()


## Feels again after [method stop].
func start() -> void:
	_is_stopped = false


## Turns a painted area on: 0 (off) to 1 of its level in the clip. It stays so where the clip, the
## skeleton or the place in the tree changes.
func trigger(effect: String, level := 1.0) -> void:
	_levels[effect] = level
	var number := _painted(effect)
	if number >= 0:
		_core.trigger(number, level)


## Turns a painted area about the body's axis (to the left, seen from above counterclockwise), and
## puts it higher, with heights about its own middle times [param stretch]. It stays so as after
## [method trigger]. Takes as long as some frames: call it as an effect begins. Volumes are nodes.
func place(effect: String, turn_degrees: float, raise_m := 0.0, stretch := 1.0) -> void:
	_places[effect] = [turn_degrees, raise_m, stretch]
	var number := _painted(effect)
	if number >= 0:
		_core.place(number, turn_degrees, raise_m, stretch)


## What each vertex of the model of an effect (its number in the clip) feels of it, 0 to 1; of several
## volumes the most.
func get_weights(effect: int) -> PackedFloat32Array:
	if _core == null:
		return PackedFloat32Array()
	var weights: PackedFloat32Array = _core.get_weights(effect)
	for volume: Dictionary in _volumes.values():
		if volume.effect == effect:
			var further: PackedFloat32Array = _core.get_weights(volume.number)
			for k in further.size():
				weights[k] = maxf(weights[k], further[k])
	return weights


## Level of an effect, with its response to the touch, 0 to 1; of several volumes the highest.
func get_level(effect: int) -> float:
	if _core == null:
		return 0.0
	var level: float = _core.get_level(effect)
	for volume: Dictionary in _volumes.values():
		if volume.effect == effect:
			level = maxf(level, _core.get_level(volume.number))
	return level


## The clip with the effects that are felt.
func get_effect_clip() -> HapticClip:
	return effects if effects != null else clip


## A transform as 3 x 4 numbers, row after row.
static func rows_of(transform: Transform3D) -> PackedFloat32Array:
	var x := transform.basis.x
	var y := transform.basis.y
	var z := transform.basis.z
	var at := transform.origin
	return PackedFloat32Array(
		[x.x, y.x, z.x, at.x, x.y, y.y, z.y, at.y, x.z, y.z, z.z, at.z]
	)


func _forget() -> void:
	_close()
	_said.clear()
	update_configuration_warnings()


## Ends in silence; what has been touched, and all impacts, are forgotten.
func _close() -> void:
	for change in ["skeleton_updated", "bone_list_changed", "rest_updated", "tree_exiting"]:
		if is_instance_valid(skeleton) and skeleton.has_signal(change):
			var handler := _keep_pose if change == "skeleton_updated" else _close
			if skeleton.is_connected(change, handler):
				skeleton.disconnect(change, handler)
	var was_open := _core != null
	_core = null
	_volumes.clear()
	_drawn.clear()
	if was_open:
		_silence()


## Opens the core where that is possible now.
func _is_open() -> bool:
	if _core != null or not is_inside_tree():
		return _core != null
	var fault := _open()
	if fault != "":
		_close()
		_say(fault)
		return false
	_say(_missing_bones())
	_say(_missing_models())
	for change in ["skeleton_updated", "bone_list_changed", "rest_updated", "tree_exiting"]:
		if skeleton.has_signal(change):
			skeleton.connect(change, _keep_pose if change == "skeleton_updated" else _close)
	return true


func _say(message: String) -> void:
	if message != "" and not _said.has(message):
		_said[message] = true
		push_warning("HapticBody '%s': %s" % [name, message])


## Number of a painted area; -1: the clip has none of this name, or the core is not open yet.
func _painted(effect: String) -> int:
	if _core == null:
		return -1
	for k in _effects.size():
		if _effects[k].name == effect and _effects[k].is_painted:
			return k
	_say("The clip has no painted area '%s'." % effect)
	return -1


func _open() -> String:
	if _core != null:
		return ""
	if clip == null:
		return "Choose a clip."
	if not is_instance_valid(skeleton):
		return "Choose the Skeleton3D of the avatar."
	if not skeleton.is_inside_tree():
		return "The skeleton is not in the scene."
	var bodies := clip.get_bodies()
	if bodies.is_empty():
		return "The clip has no body: export the scene from Blender, not a track."
	var names := bodies.map(func(each: Dictionary) -> String: return each.name)
	var number := 0 if body == "" else names.find(body)
	if number < 0:
		return "The clip has no body '%s', but: %s." % [body, ", ".join(names)]
	if not ClassDB.class_exists(&"HapticBodyCore"):
		return "The compiled part of the add-on is not there (python players/native/build.py)."
	_bones = bodies[number].bones
	_numbers = HapticBones.find(_bones, skeleton)
	if _numbers.count(-1) == _numbers.size():
		return "No bone of '%s' has a known name." % skeleton.name
	_core = ClassDB.instantiate(&"HapticBodyCore")
	var others := effects.bytes if effects != null else PackedByteArray()
	var error: int = _core.open(clip.bytes, number, others)
	if error != 0:
		_core = null
		return "The core refuses the clip (%d); 'hfx validate' says why." % error
	_effects = get_effect_clip().get_effects()
	_effect_numbers.clear()
	for k in _effects.size():
		if not _effects[k].is_painted:
			_effect_numbers[_effects[k].name] = k
		_core.trigger(k, _levels.get(_effects[k].name, 0.0) if _effects[k].is_painted else 0.0)
		if _places.has(_effects[k].name):
			_core.callv(&"place", [k] + _places[_effects[k].name])
	_from_rest.clear()
	for bone in _numbers:
		_from_rest.append(
			skeleton.get_bone_global_rest(bone).affine_inverse() * TO_GODOT
			if bone >= 0 else Transform3D.IDENTITY
		)
	return ""


## A sentence about bones of the clip that move skin and are not in the skeleton.
func _missing_bones() -> String:
	var missing := PackedStringArray()
	var moving := 0
	for k in _bones.size():
		if _core.moves_skin(k) == 1:
			moving += 1
			if _numbers[k] < 0:
				missing.append(_bones[k].name)
	if missing.is_empty():
		return ""
	var shown := ", ".join(missing.slice(0, _NAMES)) + (", ..." if missing.size() > _NAMES else "")
	return (
		"%d of %d bones that move skin are not in '%s' and follow their parents: %s."
		% [missing.size(), moving, skeleton.name, shown]
	)


## A sentence about effects of a library that the body of the clip has no skin for.
func _missing_models() -> String:
	var missing := PackedStringArray()
	for k in _effects.size():
		if effects != null and _core.get_weights(k).is_empty():
			missing.append(_effects[k].name)
	if missing.is_empty():
		return ""
	return (
		"The body does not feel %s: the scene of its clip has no effect of that modality."
		% ", ".join(missing)
	)


## Whether the pose, or the place of a volume on a bone, is known only after this frame's processing.
func _is_drawn_later() -> bool:
	if _has_modifiers():
		return true
	for volume: Dictionary in _volumes.values():
		if volume.is_late:
			return true
	return false


func _has_modifiers() -> bool:
	for child in skeleton.get_children():
		if child.is_class("SkeletonModifier3D") and child.active:
			return true
	return false


func _feel(delta: float) -> void:
	if is_inside_tree() and not _is_stopped and _has_focus and _is_open():
		values_changed.emit(advance(delta))


## Keeps the drawn pose: Godot takes the changes of modifiers back when they have been drawn.
func _keep_pose() -> void:
	if _core != null and _has_modifiers():
		_drawn = _poses()


func _poses() -> Array[Transform3D]:
	var poses: Array[Transform3D] = []
	for bone in _numbers:
		poses.append(skeleton.get_bone_global_pose(bone) if bone >= 0 else Transform3D.IDENTITY)
	return poses


## For each bone of the clip: the clip's rest space to Godot's world.
func _matrices() -> PackedFloat32Array:
	var poses := _drawn
	if poses.is_empty() or not _has_modifiers():
		poses = _poses()
	var placed: Array[Transform3D] = []
	var rows := PackedFloat32Array()
	var at := skeleton.global_transform
	for k in _bones.size():
		var parent: int = _bones[k].parent
		if _numbers[k] >= 0:
			placed.append(at * poses[k] * _from_rest[k])
		else:
			placed.append(placed[parent] if parent >= 0 else at * TO_GODOT)
		rows.append_array(rows_of(placed[k]))
	return rows


## Each visible node is a volume of its own; those that are hidden or gone are off.
func _place_volumes() -> void:
	_frame += 1
	for node: HapticVolume in get_tree().get_nodes_in_group(HapticVolume.GROUP):
		var effect: int = _effect_numbers.get(node.effect, -1)
		if effect < 0:
			_say(_unknown_effect(node))
			continue
		var id := node.get_instance_id()
		var volume: Dictionary = _volumes.get(id, {})
		if not volume.is_empty() and volume.effect != effect:
			_core.remove_volume(volume.number)
			volume = {}
		if volume.is_empty():
			var number: int = _core.add_volume(effect)
			if number < 0:
				continue
			volume = {"number": number, "effect": effect}
			_volumes[id] = volume
		volume.frame = _frame
		volume.is_late = node.is_on_bone
		_core.set_volume(volume.number, rows_of(node.global_transform * TO_GODOT))
		_core.trigger(volume.number, node.level if node.is_visible_in_tree() else 0.0)
	for id in _volumes.keys():
		if _volumes[id].frame != _frame:
			_core.remove_volume(_volumes[id].number)
			_volumes.erase(id)


func _unknown_effect(node: HapticVolume) -> String:
	if node.effect == "":
		return "HapticVolume '%s' has no effect." % node.name
	return (
		"The clip has no volume '%s', but: %s."
		% [node.effect, ", ".join(_effect_numbers.keys())]
	)
