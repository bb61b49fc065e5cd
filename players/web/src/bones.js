// Namespaces, and what Mixamo, Rigify, VRoid, 3ds Max and Character Creator put before names.
const PREFIX = /^(?:.*[:|]|mixamorig\d*_?|(?:def|org)[-_.]|j_(?:bip|sec)_(?:c_)?|bip\d*[ _]|cc_base_)/;
const SIDE_FIRST = /^(?:(left|right)|([lr])(?=[ ._-]))(.+)$/;
const SIDE_LAST = /^(.+?)(?:[ ._-]?(left|right)|[ ._-]([lr]))$/;

/**
 * Key that spellings of one bone have in common: "l upperarm" of `upper_arm.L`, `UpperArm_L`,
 * `leftUpperArm`, and of `upper_armL`, as three.js spells the first.
 */
export function boneKey(name) {
  const bare = name.replace(/([a-z0-9])([LR])$/, "$1_$2").toLowerCase().replace(PREFIX, "");
  const plain = (text) => text.replace(/[^a-z0-9]/g, "");
  const first = SIDE_FIRST.exec(bare);
  if (first) return `${(first[1] ?? first[2])[0]} ${plain(first[3])}`;
  const last = SIDE_LAST.exec(bare);
  if (last) return `${(last[2] ?? last[3])[0]} ${plain(last[1])}`;
  return plain(bare);
}

/**
 * Object for each bone of a clip's body, or null: by its name in the scene, then by its Mixamo, Unreal
 * and VRM names; first as spelt, then by `boneKey`. Objects with `isBone` come before others.
 */
export function findBones(bones, root) {
  const objects = [];
  collect(root, objects);
  objects.sort((a, b) => Number(b.isBone ?? false) - Number(a.isBone ?? false));
  const byName = new Map();
  const byKey = new Map();
  for (const object of objects) {
    for (const name of [object.name, object.userData?.name]) {
      if (!name) continue;
      if (!byName.has(name)) byName.set(name, object);
      if (!byKey.has(boneKey(name))) byKey.set(boneKey(name), object);
    }
  }
  return bones.map((bone) => {
    const names = [bone.name, bone.mixamo, bone.unreal, bone.human].filter((name) => name);
    const exact = names.find((name) => byName.has(name));
    if (exact) return byName.get(exact);
    const spelt = names.find((name) => byKey.has(boneKey(name)));
    return spelt ? byKey.get(boneKey(spelt)) : null;
  });
}

function collect(object, objects) {
  objects.push(object);
  for (const child of object.children) collect(child, objects);
}
