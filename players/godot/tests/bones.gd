# SPDX-License-Identifier: MIT
extends SceneTree
## Finds the human bones of skeletons named by common conventions: godot --headless --script
## tests/bones.gd. Ends with 1 if one is wrong.

const HapticBones := preload("res://addons/hfx/haptic_bones.gd")
const HUMAN := (
	"hips spine chest upperChest neck head leftShoulder leftUpperArm leftLowerArm leftHand"
	+ " leftThumbMetacarpal leftThumbProximal leftThumbDistal leftIndexProximal leftLittleDistal"
	+ " rightUpperLeg rightLowerLeg rightFoot rightToes"
)
## In the order of HUMAN; -: the rig has no such bone. Each bone is the child of the one before.
const RIGS := {
	"Mixamo": (
		"mixamorig:Hips mixamorig:Spine mixamorig:Spine1 mixamorig:Spine2 mixamorig:Neck mixamorig:Head"
		+ " mixamorig:LeftShoulder mixamorig:LeftArm mixamorig:LeftForeArm mixamorig:LeftHand"
		+ " mixamorig:LeftHandThumb1 mixamorig:LeftHandThumb2 mixamorig:LeftHandThumb3"
		+ " mixamorig:LeftHandIndex1 mixamorig:LeftHandPinky3 mixamorig:RightUpLeg mixamorig:RightLeg"
		+ " mixamorig:RightFoot mixamorig:RightToeBase"
	),
	"Mixamo, other prefix": (
		"mixamorig7_Hips mixamorig7_Spine mixamorig7_Spine1 mixamorig7_Spine2 mixamorig7_Neck"
		+ " mixamorig7_Head mixamorig7_LeftShoulder mixamorig7_LeftArm mixamorig7_LeftForeArm"
		+ " mixamorig7_LeftHand mixamorig7_LeftHandThumb1 mixamorig7_LeftHandThumb2"
		+ " mixamorig7_LeftHandThumb3 mixamorig7_LeftHandIndex1 mixamorig7_LeftHandPinky3"
		+ " mixamorig7_RightUpLeg mixamorig7_RightLeg mixamorig7_RightFoot mixamorig7_RightToeBase"
	),
	"Godot": (
		"Hips Spine Chest UpperChest Neck Head LeftShoulder LeftUpperArm LeftLowerArm LeftHand"
		+ " LeftThumbMetacarpal LeftThumbProximal LeftThumbDistal LeftIndexProximal LeftLittleDistal"
		+ " RightUpperLeg RightLowerLeg RightFoot RightToes"
	),
	"Unity": (
		"Hips Spine Chest UpperChest Neck Head LeftShoulder LeftUpperArm LeftLowerArm LeftHand"
		+ " LeftThumbProximal LeftThumbIntermediate LeftThumbDistal LeftIndexProximal LeftLittleDistal"
		+ " RightUpperLeg RightLowerLeg RightFoot RightToes"
	),
	"VRoid": (
		"J_Bip_C_Hips J_Bip_C_Spine J_Bip_C_Chest J_Bip_C_UpperChest J_Bip_C_Neck J_Bip_C_Head"
		+ " J_Bip_L_Shoulder J_Bip_L_UpperArm J_Bip_L_LowerArm J_Bip_L_Hand J_Bip_L_Thumb1 J_Bip_L_Thumb2"
		+ " J_Bip_L_Thumb3 J_Bip_L_Index1 J_Bip_L_Little3 J_Bip_R_UpperLeg J_Bip_R_LowerLeg J_Bip_R_Foot"
		+ " J_Bip_R_ToeBase"
	),
	"Unreal": (
		"pelvis spine_01 spine_02 spine_03 neck_01 head clavicle_l upperarm_l lowerarm_l hand_l thumb_01_l"
		+ " thumb_02_l thumb_03_l index_01_l pinky_03_l thigh_r calf_r foot_r ball_r"
	),
	"Rigify": (
		"DEF-spine DEF-spine.001 DEF-spine.002 DEF-spine.003 DEF-spine.004 DEF-spine.006 DEF-shoulder.L"
		+ " DEF-upper_arm.L DEF-forearm.L DEF-hand.L DEF-thumb.01.L DEF-thumb.02.L DEF-thumb.03.L"
		+ " DEF-f_index.01.L DEF-f_pinky.03.L DEF-thigh.R DEF-shin.R DEF-foot.R DEF-toe.R"
	),
	"Biped": (
		"Bip01_Pelvis Bip01_Spine Bip01_Spine1 Bip01_Spine2 Bip01_Neck Bip01_Head Bip01_L_Clavicle"
		+ " Bip01_L_UpperArm Bip01_L_Forearm Bip01_L_Hand Bip01_L_Finger0 Bip01_L_Finger01"
		+ " Bip01_L_Finger02 Bip01_L_Finger1 Bip01_L_Finger42 Bip01_R_Thigh Bip01_R_Calf Bip01_R_Foot"
		+ " Bip01_R_Toe0"
	),
	"Character Creator": (
		"CC_Base_Hip CC_Base_Waist CC_Base_Spine01 CC_Base_Spine02 CC_Base_NeckTwist01 CC_Base_Head"
		+ " CC_Base_L_Clavicle CC_Base_L_Upperarm CC_Base_L_Forearm CC_Base_L_Hand CC_Base_L_Thumb1"
		+ " CC_Base_L_Thumb2 CC_Base_L_Thumb3 CC_Base_L_Index1 CC_Base_L_Pinky3 CC_Base_R_Thigh"
		+ " CC_Base_R_Calf CC_Base_R_Foot CC_Base_R_ToeBase"
	),
	"SMPL": (
		"Pelvis Spine1 Spine2 Spine3 Neck Head L_Collar L_Shoulder L_Elbow L_Wrist - - - - - R_Hip R_Knee"
		+ " R_Ankle -"
	),
	"sides joined": (
		"hips spine chest upperchest neck head leftshoulder leftarm leftforearm handl - - - - - thighr shinr"
		+ " rightfoot rtoe"
	),
}
## Bones that are none of a body's own.
const OTHERS := "hand_ik.L upperarm_twist_01_l ORG-thigh.L hair_01 camera root mixamorig:LeftHandThumb4"

var _wrong := 0


func _init() -> void:
	var human := HUMAN.split(" ")
	for rig in RIGS:
		var names: PackedStringArray = RIGS[rig].split(" ")
		var skeleton := _skeleton(names)
		var found := HapticBones.human_bones(skeleton)
		for k in human.size():
			var bone: String = skeleton.get_bone_name(found[human[k]]) if found.has(human[k]) else "-"
			if bone != names[k].replace(":", "_") and bone != names[k]:
				_wrong += 1
				print("%s, %s: %s instead of %s" % [rig, human[k], bone, names[k]])
		skeleton.free()
	var others := _skeleton(OTHERS.split(" "))
	if not HapticBones.human_bones(others).is_empty():
		_wrong += 1
		print("no bones of a body: %s" % HapticBones.human_bones(others))
	others.free()
	print("%d rigs, %d wrong" % [RIGS.size(), _wrong])
	quit(1 if _wrong > 0 else 0)


func _skeleton(names: PackedStringArray) -> Skeleton3D:
	var skeleton := Skeleton3D.new()
	for name in names:
		if name != "-":
			skeleton.add_bone(name.replace(":", "_"))
			if skeleton.get_bone_count() > 1:
				skeleton.set_bone_parent(skeleton.get_bone_count() - 1, skeleton.get_bone_count() - 2)
	return skeleton
