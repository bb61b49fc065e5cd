# SPDX-License-Identifier: MIT
@tool
extends RefCounted
## Finds the bones of a [Skeleton3D] that correspond to the bones of a clip, by name.
##
## A skeleton of the clip's own rig is matched name by name. Any other one is matched by the human
## bones that the names stand for: VRM and Godot's humanoid profile, Mixamo (any prefix and
## separator), Unreal, Rigify (DEF-), Biped, Daz, Character Creator and plain left/right names.

## Share of a clip's bones above which a skeleton counts as the clip's own rig.
const _OWN_RIG := 0.6
const _FALLBACKS := {
	"upperChest": "chest", "chest": "spine", "jaw": "head", "leftEye": "head", "rightEye": "head",
}
const _CENTRE := {
	"hips": "hips hip pelvis",
	"spine": (
		"spine chest upperchest lowerchest chestupper chestlower abdomen abdomenupper abdomenlower"
		+ " torso waist upperspine lowerspine back"
	),
	"neck": "neck necklower neckupper necktwist lowerneck upperneck",
	"head": "head",
	"jaw": "jaw lowerjaw",
}
const _SIDED := {
	"Collar": "clavicle clav collar collarbone",
	"Shoulder": "shoulder shldr",
	"UpperArm": "upperarm uparm uarm armupper shldrbend upperarmbend shoulderbend armstretch humerus",
	"Arm": "arm",
	"LowerArm": "lowerarm loarm lowarm larm forearm armlower forearmbend forearmstretch elbow",
	"Hand": "hand wrist",
	"UpperLeg": "upperleg upleg uleg thigh legupper thighbend thighstretch femur",
	"Leg": "leg",
	"Hip": "hip hips",
	"LowerLeg": "lowerleg loleg lowleg lleg leglower shin calf knee legstretch",
	"Foot": "foot ankle",
	"Toes": "toe toes toebase ball",
	"Eye": "eye",
}
const _DIGITS: PackedStringArray = ["Thumb", "Index", "Middle", "Ring", "Little"]
const _DIGIT_WORDS := {
	"thumb": 0, "index": 1, "pointer": 1, "middle": 2, "mid": 2, "ring": 3, "pinky": 4, "little": 4,
}
const _PHALANGES := {"metacarpal": 0, "proximal": 1, "intermediate": 2, "medial": 2, "distal": 3}
const _FILLERS: PackedStringArray = ["bone", "bn", "joint", "jnt", "j", "b", "bind", "skin", "rig"]
const _SIDES := {"l": "left", "left": "left", "r": "right", "right": "right"}

static var _prefix := RegEx.create_from_string(
	"^(?i:mixamorig\\d*|j_bip|(?:valvebiped[._])?bip\\d*|cc_base|def)(?=[\\s_\\-.:A-Z])"
)
static var _tokens := RegEx.create_from_string("[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\\d+")


## For each bone of a clip (as of [method HapticClip.get_bodies]) the number of the skeleton's bone;
## -1: there is none.
static func find(bones: Array, skeleton: Skeleton3D) -> PackedInt32Array:
	var by_name := {}
	for number in skeleton.get_bone_count():
		var plain := _plain(skeleton.get_bone_name(number))
		if not by_name.has(plain):
			by_name[plain] = number
	var by_human := human_bones(skeleton)
	var named := 0
	for bone in bones:
		named += int(by_name.has(_plain(bone.name)))
	var is_own := named > _OWN_RIG * bones.size()
	var found := PackedInt32Array()
	for bone in bones:
		var number: int = by_name.get(_plain(bone.name), -1)
		if bone.human != "" and not (is_own and number >= 0):
			number = by_human.get(bone.human, -1)
			var human: String = bone.human
			while number < 0 and _FALLBACKS.has(human):
				human = _FALLBACKS[human]
				number = by_human.get(human, -1)
		found.append(number)
	return found


## VRM's human bones (leftUpperArm) of a skeleton, with the numbers of its bones.
static func human_bones(skeleton: Skeleton3D) -> Dictionary:
	var candidates := {}  # slot: bones, the one without numbers and nearest to the root first
	for number in skeleton.get_bone_count():
		var slot := _slot(skeleton.get_bone_name(number))
		if slot.is_empty():
			continue
		var depth := 0
		var parent := skeleton.get_bone_parent(number)
		while parent >= 0:
			depth += 1
			parent = skeleton.get_bone_parent(parent)
		if not candidates.has(slot[0]):
			candidates[slot[0]] = []
		candidates[slot[0]].append([slot[1], depth, number])
	var first := {}
	for slot in candidates:
		candidates[slot].sort()
		first[slot] = candidates[slot][0][2]
	var found := {}
	for side in ["left", "right"]:
		_find_limbs(side, first, found)
	_find_spine(candidates, first, found)
	return found


static func _find_limbs(side: String, first: Dictionary, found: Dictionary) -> void:
	var choices := {
		"Shoulder": ["Collar", "Shoulder"],
		"UpperArm": ["UpperArm", "Arm"],
		"LowerArm": ["LowerArm"],
		"Hand": ["Hand"],
		"UpperLeg": ["UpperLeg"],
		"LowerLeg": ["LowerLeg", "Leg"],
		"Foot": ["Foot"],
		"Toes": ["Toes"],
		"Eye": ["Eye"],
	}
	if first.has(side + "UpperArm"):
		choices.LowerArm.append("Arm")  # upper arm and arm
	elif not first.has(side + "Arm"):
		choices.UpperArm.append("Shoulder")  # collar and shoulder
		choices.Shoulder = ["Collar"]
	if first.has(side + "LowerLeg"):
		choices.UpperLeg.append("Leg")  # leg and knee
	choices.UpperLeg.append("Hip")
	for human in choices:
		for slot in choices[human]:
			if not found.has(side + human) and first.has(side + slot):
				found[side + human] = first[side + slot]
	for digit in _DIGITS:
		var joints: Array[String] = ["Metacarpal", "Proximal", "Distal"]
		if digit != "Thumb":
			joints = ["Proximal", "Intermediate", "Distal"]
		for joint in 3:
			var slot := "%s%s%d" % [side, digit, joint + 1]
			if first.has(slot):
				found[side + digit + joints[joint]] = first[slot]
	# Words instead of numbers: metacarpal, proximal, distal, or proximal, intermediate, distal.
	var is_long := first.has(side + "Thumbintermediate")
	var words := {"metacarpal": "Metacarpal", "proximal": "Proximal", "distal": "Distal"}
	if is_long:
		words = {"proximal": "Metacarpal", "intermediate": "Proximal", "distal": "Distal"}
	for word in words:
		if first.has(side + "Thumb" + word):
			found[side + "Thumb" + words[word]] = first[side + "Thumb" + word]


static func _find_spine(candidates: Dictionary, first: Dictionary, found: Dictionary) -> void:
	var chain: Array = candidates.get("spine", []).duplicate()
	chain.sort_custom(func(one, other): return one[1] < other[1])
	for human in ["hips", "neck", "head", "jaw"]:
		if first.has(human):
			found[human] = first[human]
	if not found.has("hips") and chain.size() > 1:  # Rigify: all of the spine, from hips to head
		found["hips"] = chain.pop_front()[2]
	if not found.has("head") and chain.size() > 3:
		found["head"] = chain.pop_back()[2]
		if not found.has("neck"):
			found["neck"] = chain[mini(3, chain.size() - 1)][2]
			chain = chain.slice(0, mini(3, chain.size() - 1))
	if chain.is_empty():
		return
	found["spine"] = chain[0][2]
	if chain.size() > 1:
		found["chest"] = chain[chain.size() / 2][2]
	if chain.size() > 2:
		found["upperChest"] = chain[-1][2]


## Slot of a bone's name and how far the name is from the plain one; empty: no human bone.
static func _slot(name: String) -> Array:
	var local := name.get_slice("|", name.get_slice_count("|") - 1)
	local = local.get_slice(":", local.get_slice_count(":") - 1)
	var prefix := _prefix.search(local)
	if prefix != null:
		local = local.substr(prefix.get_end())
	var side := ""
	var words: PackedStringArray = []
	var numbers: PackedStringArray = []
	for token in _tokens.search_all(local):
		var word := token.get_string().to_lower()
		if word.is_valid_int():
			numbers.append(word)
		elif _SIDES.has(word) and side == "":
			side = _SIDES[word]
		elif not word in _FILLERS:
			words.append(word)
	if words.size() > 1 and words[0] in ["c", "m"]:
		words.remove_at(0)
	var stem := "".join(words)
	if side == "":
		for mark in ["left", "right", "l", "r"]:  # joined to the word: handl, leftarm
			for rest in [stem.trim_prefix(mark), stem.trim_suffix(mark)]:
				if side == "" and rest != stem and (_find_in(_SIDED, rest) != "" or rest in _DIGIT_WORDS):
					side = _SIDES[mark]
					stem = rest
					words = [rest]
	var finger := _finger(words, numbers)
	if finger != "":
		return [side + finger, numbers.size()] if side != "" else []
	if side == "":
		var slot := _find_in(_CENTRE, stem)
		return [slot, numbers.size() if slot != "spine" else 0] if slot != "" else []
	var limb := _find_in(_SIDED, stem)
	return [side + limb, numbers.size()] if limb != "" else []


## A digit and its joint: a number from 1 ("Index1"), of a thumb also a word ("Thumbdistal").
static func _finger(words: PackedStringArray, numbers: PackedStringArray) -> String:
	var digit := -1
	var phalanx := ""
	var has_finger := false
	for word in words:
		if _DIGIT_WORDS.has(word) and digit < 0:
			digit = _DIGIT_WORDS[word]
		elif _PHALANGES.has(word):
			phalanx = word
		elif word == "finger" or word == "fingers":
			has_finger = true
		elif not word in ["hand", "f"]:
			return ""
	var joint := int(numbers[-1]) if numbers.size() > 0 else 1
	if digit < 0:
		if not has_finger or numbers.is_empty():
			return ""
		digit = int(numbers[0]) - 1  # finger1-1
		if numbers.size() == 1:  # Biped's Finger0, Finger01, Finger02: a thumb
			digit = int(numbers[0].left(1))
			joint = int(numbers[0].substr(1)) + 1
		if digit < 0 or digit > 4:
			return ""
	if phalanx != "":
		if digit == 0:
			return "Thumb" + ("intermediate" if phalanx == "medial" else phalanx)
		joint = _PHALANGES[phalanx]
	return "%s%d" % [_DIGITS[digit], joint] if joint >= 1 and joint <= 3 else ""


static func _find_in(table: Dictionary, stem: String) -> String:
	for slot in table:
		if stem in table[slot].split(" "):
			return slot
	return ""


## A name without separators and upper case, and without a namespace.
static func _plain(name: String) -> String:
	var plain := ""
	for letter in name.get_slice(":", name.get_slice_count(":") - 1).to_lower():
		if not letter in " ._-/":
			plain += letter
	return plain
