# SPDX-License-Identifier: MIT
@tool
extends RefCounted
## Creates [HapticVolume] nodes for the volumes of a clip.


## A volume node for each volume effect of a clip that no node below [param scene] has: parent, node
## (not added yet), owned, the nodes that need an owner, and instances, the instanced scenes round the
## parent: their children have to be editable, or the scene is saved without the node. A volume hangs below the Node3D, or the
## bone, of the effect's name, else below the scene; its place in the world is that of the effect where
## Blender's scene has it first.
static func create(clip: HapticClip, scene: Node, skeleton: Skeleton3D) -> Array[Dictionary]:
	var known := {}
	for node: HapticVolume in scene.find_children("*", "HapticVolume", true, false):
		known[node.effect] = true
	var created: Array[Dictionary] = []
	for effect in clip.get_effects():
		if effect.is_painted or known.has(effect.name):
			continue
		var volume := HapticVolume.new()
		volume.name = effect.name.validate_node_name()
		volume.effect = effect.name
		volume.shape = effect.shape
		volume.half_segment = effect.half_segment if effect.shape == "capsule" else 1.0
		var parent := _node_named(scene, effect.name)
		var at := Transform3D.IDENTITY
		var bone := skeleton.find_bone(effect.name) if is_instance_valid(skeleton) else -1
		var top: Node3D = volume
		var owned: Array[Node] = [volume]
		if parent != null:
			at = _in_world(parent)
		elif bone >= 0:
			parent = skeleton
			at = _in_world(skeleton) * skeleton.get_bone_global_pose(bone)
			top = BoneAttachment3D.new()
			top.name = "%s on bone" % volume.name
			top.bone_name = effect.name
			top.add_child(volume)
			owned.push_front(top)
		elif scene is Node3D:
			at = _in_world(scene)
		volume.transform = at.affine_inverse() * effect.transform
		if parent == null:
			parent = scene
		var instances := _instances_above(parent, scene)
		created.append({"parent": parent, "node": top, "owned": owned, "instances": instances})
	return created


## Roots of the instanced scenes in [param scene] that contain a node, the innermost first.
static func _instances_above(node: Node, scene: Node) -> Array[Node]:
	var instances: Array[Node] = []
	while node != scene and node.owner != null and node.owner != scene:
		instances.append(node.owner)
		node = node.owner
	return instances


static func _node_named(scene: Node, name: String) -> Node3D:
	var plain := name.validate_node_name().to_lower()
	for node in scene.find_children("*", "Node3D", true, false):
		if String(node.name).to_lower() == plain and not node is HapticVolume:
			return node
	return null


static func _in_world(node: Node3D) -> Transform3D:
	return node.global_transform if node.is_inside_tree() else node.transform
