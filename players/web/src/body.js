import { unknownName } from "./clip.js";
import { HapticError } from "./core.js";
import { findBones } from "./bones.js";

/**
 * Writes the product of `a` and `b` (null: `a` alone), 16 numbers each, column after column, as three.js
 * stores matrices, as a matrix of the clip: 3 x 4, row after row. The clip's (x, y, z) is three.js'
 * (x, z, -y), so columns of the result are the product's x, -z, y and its place.
 */
function writeClipMatrix(a, b, to, at) {
  for (let column = 0; column < 4; column++) {
    const from = column === 1 ? 2 : column === 2 ? 1 : column;
    for (let row = 0; row < 3; row++) {
      let sum = a[4 * from + row];
      if (b) {
        sum = 0;
        for (let k = 0; k < 4; k++) sum += a[4 * k + row] * b[4 * from + k];
      }
      to[at + 4 * row + column] = column === 1 ? -sum : sum;
    }
  }
}

/** `inverse(a) * b` of affine matrices, column after column; null: `a` is flat. */
function relative(a, b) {
  const cross = (i, k) => [
    a[4 * i + 1] * a[4 * k + 2] - a[4 * i + 2] * a[4 * k + 1],
    a[4 * i + 2] * a[4 * k] - a[4 * i] * a[4 * k + 2],
    a[4 * i] * a[4 * k + 1] - a[4 * i + 1] * a[4 * k],
  ];
  const rows = [cross(1, 2), cross(2, 0), cross(0, 1)];
  const determinant = a[0] * rows[0][0] + a[1] * rows[0][1] + a[2] * rows[0][2];
  if (!determinant) return null;
  const found = new Float64Array(16);
  for (let column = 0; column < 4; column++) {
    const away = [0, 1, 2].map((k) => b[4 * column + k] - (column === 3 ? a[12 + k] : 0));
    rows.forEach((row, k) => {
      found[4 * column + k] = (row[0] * away[0] + row[1] * away[1] + row[2] * away[2]) / determinant;
    });
  }
  found[15] = 1;
  return found;
}

/** A volume of a clip that follows an object. */
export class HapticVolume {
  constructor(effect, object, level, numbers) {
    this.effect = effect;
    this.object = object;
    this.level = level;
    this.numbers = numbers; // in the core: one for each effect of this name
  }
}

/** An avatar that feels volumes and painted areas of a clip on its own moves. */
export class HapticBody {
  #at;
  #effects; // clip of the effects, in the memory of the clip of the body
  #out;
  #memory; // of one matrix for each bone, at least one
  #matrices;
  #objects = null; // for each bone; null: as its parent
  #fromRest; // rest space in three.js' axes to the object at rest
  #space; // object whose space is the rest space
  #volumes = new Set();
  #unused = new Map(); // effect: memory of volumes that were removed

  constructor(clip, { body = "", effects = clip } = {}) {
    const { core } = clip;
    const names = clip.bodies.map((item) => item.name);
    const index = body ? names.indexOf(body) : 0;
    if (index < 0) throw unknownName("body", body, names);
    if (!names.length) throw new HapticError("The clip has no body: export it from a scene, not from a track.", -6);
    this.clip = clip;
    this.effectClip = effects;
    this.index = index;
    this.bones = clip.bodies[index].bones;
    this.values = clip.neutralValues();
    this.missing = [];
    this.#matrices = new Float32Array(12 * this.bones.length);
    this.#at = core.take(core.calls.hfx_body_size(), this);
    this.#out = core.take(4 * this.values.length || 4, this);
    this.#memory = core.take(48 * Math.max(this.bones.length, 1), this);
    this.#effects = effects === clip ? clip.address : this.#copied(effects);
    const size = core.calls.hfx_body_effects_bytes(clip.address, index, this.#effects);
    const memory = core.take(size, this);
    core.check(core.calls.hfx_body_open_effects(this.#at, clip.address, index, this.#effects, memory, size));
    const unfelt = effects === clip ? [] : effects.effects.filter((_, k) => !this.weights(k).length).map((item) => item.name);
    if (unfelt.length) console.warn(`The haptic body does not feel ${unfelt.join(", ")}: the scene of its clip has no effect of that modality.`);
    // A volume is felt where the game adds one.
    effects.effects.forEach((effect, k) => effect.isPainted || this.triggerEffect(k, 0));
  }

  /**
   * Follows the skeleton below an object of three.js, in its rest pose now. Sets `missing` to the names of
   * bones that move skin and were not found; these follow their parents.
   */
  attach(root, { space = null } = {}) {
    root.updateWorldMatrix?.(true, true);
    const objects = findBones(this.bones, root);
    const top = objects.find((object) => object);
    if (!top) throw new Error(`No object below '${root.name}' has a name of a bone of '${this.clip.bodies[this.index].name}'.`);
    this.missing = this.bones.filter((bone, k) => bone.hasSkin && !objects[k]).map((bone) => bone.name);
    if (this.missing.length)
      console.warn(`The haptic body found no object for ${this.missing.length} bones; they follow their parents: ${this.missing.join(", ")}.`);
    this.#space = space ?? spaceOf(top, root);
    this.#fromRest = objects.map((object) => object && relative(object.matrixWorld.elements, this.#space.matrixWorld.elements));
    this.#objects = objects.map((object, k) => (this.#fromRest[k] ? object : null));
  }

  /** Opens another clip in the memory of the body's; its address. */
  #copied(effects) {
    const { core } = this.clip;
    const { start, length } = effects.content;
    const bytes = core.take(length, this);
    const address = core.take(core.calls.hfx_clip_size(), this);
    core.bytes(bytes, length).set(effects.core.bytes(start, length));
    core.check(core.calls.hfx_clip_open(address, bytes, length));
    return address;
  }

  /** Adds a volume that follows an object; its shape has unit size, so scale the object as in Blender. */
  addVolume(effect, object, level = 1) {
    if (!object?.matrixWorld) {
      throw new HapticError(`The object of the volume "${effect}" is no Object3D of three.js.`, -6);
    }
    const { core } = this.clip;
    const { effects } = this.effectClip;
    const numbers = [];
    effects.forEach((item, k) => {
      if (item.name !== effect || item.isPainted) return;
      const size = core.calls.hfx_body_effects_volume_bytes(this.clip.address, this.index, this.#effects, k);
      const memory = this.#unused.get(k)?.pop() ?? core.take(size, this);
      numbers.push(core.calls.hfx_body_add_volume(this.#at, k, memory, size) >>> 0);
    });
    if (!numbers.length) {
      const known = effects.filter((item) => !item.isPainted).map((item) => item.name);
      throw unknownName("volume", effect, known);
    }
    const volume = new HapticVolume(effect, object, level, numbers);
    this.#volumes.add(volume);
    return volume;
  }

  removeVolume(volume) {
    if (!this.#volumes.delete(volume)) return;
    const indices = this.#named(volume.effect, false);
    volume.numbers.forEach((number, k) => {
      const memory = this.clip.core.calls.hfx_body_remove_volume(this.#at, number);
      if (!this.#unused.has(indices[k])) this.#unused.set(indices[k], []);
      this.#unused.get(indices[k]).push(memory);
    });
  }

  /** Turns a painted area on, at a level of 0 (off) to 1 of its own. */
  trigger(effect, level = 1) {
    for (const index of this.#painted(effect)) this.triggerEffect(index, level);
  }

  /**
   * Turns a painted area about the body's axis (degrees to the left, seen from above counterclockwise), raises it by
   * metres, and multiplies heights about its own middle; 0, 0, 1: as made. Takes as long as some frames. Volumes
   * follow objects.
   */
  place(effect, turnDegrees, raiseM = 0, stretch = 1) {
    for (const index of this.#painted(effect)) this.placeEffect(index, turnDegrees, raiseM, stretch);
  }

  /** Goes on by seconds: takes the pose and the volumes of now, and returns `values`. */
  advance(seconds) {
    if (this.#objects) this.#pose();
    for (const volume of this.#volumes) {
      volume.object.updateWorldMatrix?.(true, false);
      writeClipMatrix(volume.object.matrixWorld.elements, null, this.#matrices, 0);
      for (const number of volume.numbers) {
        this.setVolume(number, this.#matrices);
        this.triggerEffect(number, volume.level);
      }
    }
    return this.evaluate(seconds);
  }

  /** Makes all values neutral until the next `advance`. */
  silence() {
    for (let k = 0; k < this.values.length; k++) this.values[k] = this.clip.columns[k].neutral;
    return this.values;
  }

  /** Poses the body: 12 numbers for each bone, rest space to world, in the clip's axes. */
  setBones(matrices) {
    const { core } = this.clip;
    if (matrices.length !== 12 * this.bones.length) throw new RangeError(`The body has ${this.bones.length} bones, 12 numbers each.`);
    core.floats(this.#memory, matrices.length).set(matrices);
    core.calls.hfx_body_set_bones(this.#at, this.#memory);
  }

  /** Places a volume: 12 numbers, shape space to world, in the clip's axes. */
  setVolume(number, matrix) {
    const { core } = this.clip;
    core.floats(this.#memory, 12).set(matrix.length > 12 ? matrix.subarray(0, 12) : matrix);
    core.check(core.calls.hfx_body_set_volume(this.#at, number, this.#memory));
  }

  /** Sets the level of an effect by its index in the clip, or of a volume by its number. */
  triggerEffect(number, level) {
    this.clip.core.check(this.clip.core.calls.hfx_body_trigger(this.#at, number, level));
  }

  /** Turns, raises and stretches a painted area by its index in the clip. */
  placeEffect(number, turnDegrees, raiseM, stretch) {
    this.clip.core.check(this.clip.core.calls.hfx_body_place(this.#at, number, turnDegrees, raiseM, stretch));
  }

  /** Changes a parameter (0: strength) in its unit, of an effect by its index or a volume by its number. */
  setParameter(number, parameter, value) {
    this.clip.core.check(this.clip.core.calls.hfx_body_set_parameter(this.#at, number, parameter, value));
  }

  /** Evaluates the body as it was posed; returns `values`. */
  evaluate(seconds) {
    const { core } = this.clip;
    core.calls.hfx_body_evaluate(this.#at, seconds, this.#out);
    this.values.set(core.floats(this.#out, this.values.length));
    return this.values;
  }

  /** Weights 0 to 1 of the last evaluation at the vertices of an effect's model. */
  weights(number) {
    const { core } = this.clip;
    const address = core.calls.hfx_body_weights(this.#at, number, this.#memory);
    const count = core.bytes(this.#memory, 4).reduceRight((sum, byte) => 256 * sum + byte, 0);
    return count ? core.floats(address, count).slice() : new Float32Array(0);
  }

  /** Level of the last evaluation, the response to the touch included. */
  level(number) {
    return this.clip.core.calls.hfx_body_level(this.#at, number);
  }

  #painted(name) {
    const indices = this.#named(name, true);
    if (indices.length) return indices;
    const known = this.effectClip.effects.filter((item) => item.isPainted).map((item) => item.name);
    throw unknownName("painted area", name, known);
  }

  #named(name, isPainted) {
    return this.effectClip.effects.flatMap((item, k) => (item.name === name && item.isPainted === isPainted ? [k] : []));
  }

  #pose() {
    this.#space.updateWorldMatrix?.(true, true);
    for (let k = 0; k < this.bones.length; k++) {
      const parent = this.bones[k].parent;
      if (this.#objects[k]) writeClipMatrix(this.#objects[k].matrixWorld.elements, this.#fromRest[k], this.#matrices, 12 * k);
      else if (parent < 0) writeClipMatrix(this.#space.matrixWorld.elements, null, this.#matrices, 12 * k);
      else this.#matrices.copyWithin(12 * k, 12 * parent, 12 * parent + 12);
    }
    this.setBones(this.#matrices);
  }
}

/** The nearest object above a bone that is no bone, usually the armature; at most `root`. */
function spaceOf(bone, root) {
  let object = bone;
  while (object !== root && object.parent && (object === bone || object.isBone)) object = object.parent;
  return object;
}
