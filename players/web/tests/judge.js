// Judges of the package, for Node and for browsers. SPDX-License-Identifier: MIT

const STEP = 1 / 65535;
const ROUNDING = 1e-6; // of numbers in 32 bits

/** Plays a clip of players/conformance by its calls; numbers compared and sentences about wrong ones. */
export async function judgeClip(hfx, bytes, text, name) {
  const clip = await hfx.HapticClip.from(bytes);
  const player = new hfx.HapticPlayer(clip);
  const strengths = new Set(clip.actuators.map((actuator) => actuator.firstColumn));
  const factors = new Map();
  const result = { compared: 0, wrong: [] };
  text.split("\n").forEach((line, number) => {
    if (!line) return;
    const [call, expected] = line.split(" = ");
    const [word, ...rest] = call.split(" ");
    const argument = rest.join(" ");
    if (word === "columns") {
      if (clip.columns.length !== Number(argument)) result.wrong.push(`${name} has ${clip.columns.length} columns`);
    } else if (word === "play" || word === "named") {
      player.gain = 1;
      player.loop = false;
      for (const parameter of factors.keys()) player.setParameter(parameter, 1);
      factors.clear();
      player.play(argument);
    } else if (word === "gain") {
      player.gain = Number(argument);
    } else if (word === "parameter") {
      factors.set(rest[0], Number(rest[1]));
      if (!player.setParameter(rest[0], Number(rest[1]))) result.wrong.push(`${name}, line ${number + 1}`);
    } else if (word === "loop") {
      player.loop = argument === "1";
    } else if (word === "pause") {
      player.pause(argument === "1");
    } else if (word === "stop") {
      player.stop();
    } else if (word === "seek") {
      player.seek(Number(argument));
    } else if (word === "advance" || word === "silence") {
      if (word === "silence") player.pause();
      else player.advance(Number(argument));
      expected.split(" ").forEach((value, k) => {
        const { parameter, lowest, highest } = clip.columns[k];
        const scale = (factors.get(parameter) ?? 1) * (strengths.has(k) ? player.gain : 1);
        const largest = Math.max(Math.abs(lowest), Math.abs(highest));
        const slack = STEP * (highest - lowest) * Math.max(scale, 1) + ROUNDING * largest;
        result.compared += 1;
        if (!(Math.abs(player.values[k] - Number(value)) <= slack))
          result.wrong.push(`${name}, line ${number + 1}, column ${k}: ${player.values[k]} instead of ${value}`);
      });
    } else {
      result.wrong.push(`${name}, line ${number + 1}: unknown call ${word}`);
    }
  });
  return result;
}

/**
 * Walks the body of players/conformance/spatial. With `posed`, bones are objects as of three.js with axes and
 * names of their own, and volumes are objects that volumes of the package follow.
 */
export async function judgeWalk(hfx, bytes, text, posed) {
  const clip = await hfx.HapticClip.from(bytes);
  const body = new hfx.HapticBody(clip);
  const bones = new Float32Array(12 * body.bones.length);
  const scene = posed ? new Skeleton(body) : null;
  const result = { compared: 0, wrong: [] };
  let evaluated = 0;
  for (const line of text.split("\n")) {
    const [word, ...rest] = line.split(" ");
    const numbers = rest.map(Number);
    if (word === "bone") {
      bones.set(numbers.slice(1), 12 * numbers[0]);
    } else if (word === "volume") {
      if (posed) scene.place(numbers[0], numbers[1], numbers.slice(2));
      else {
        body.setVolume(numbers[0], numbers.slice(2));
        body.triggerEffect(numbers[0], numbers[1]);
      }
    } else if (word === "evaluate") {
      evaluated += 1;
      if (posed) {
        scene.pose(bones);
        body.advance(numbers[0]);
      } else {
        body.setBones(bones);
        body.evaluate(numbers[0]);
      }
    } else if (word === "felt") {
      const number = posed ? scene.volumes[numbers[0]].numbers[0] : numbers[0];
      const weights = body.weights(number);
      const level = body.level(number);
      const expected = new Map(rest.slice(1).map((item) => item.split(":").map(Number)));
      for (let k = 0; k < weights.length; k++) {
        const value = expected.get(k) ?? 0;
        if (value) result.compared += 1;
        if (!(Math.abs(weights[k] * level - value) <= 1 / 255))
          result.wrong.push(`moment ${evaluated}, effect ${numbers[0]}, vertex ${k}: ${weights[k] * level} instead of ${value}`);
      }
    }
  }
  return result;
}

/** Objects like three.js': names, parents, matrixWorld; the clip's (x, y, z) is (x, z, -y) of their world. */
class Skeleton {
  constructor(body) {
    this.body = body;
    this.volumes = [];
    const root = node("Avatar", null);
    const armature = node("Armature", root);
    armature.matrixWorld.elements = placed(7, [0.3, -0.2, 0.5]);
    this.armature = armature;
    this.own = body.bones.map((_, k) => placed(k + 1, [0.1 * k, 0.02 * k, -0.05 * k]));
    this.bones = body.bones.map((bone) => ({ ...node(bone.name.replace(/[.:]/g, ""), null), isBone: true }));
    this.bones.forEach((bone, k) => {
      const parent = body.bones[k].parent;
      bone.parent = parent < 0 ? armature : this.bones[parent];
      bone.parent.children.push(bone);
      // At rest a bone stands somewhere in the armature's space, on axes of its own.
      bone.matrixWorld.elements = product(armature.matrixWorld.elements, this.own[k]);
    });
    body.attach(root);
  }

  /** Bone K, whose rest space moved by M (clip's axes): M in these axes, then its place at rest. */
  pose(matrices) {
    this.bones.forEach((bone, k) => {
      bone.matrixWorld.elements = product(toThree(matrices.subarray(12 * k, 12 * k + 12)), this.own[k]);
    });
  }

  place(effect, level, matrix) {
    this.volumes[effect] ??= this.body.addVolume(this.body.clip.effects[effect].name, node("volume", null));
    this.volumes[effect].level = level;
    this.volumes[effect].object.matrixWorld.elements = toThree(matrix);
  }
}

function node(name, parent) {
  const made = { name, parent, children: [], matrixWorld: { elements: placed(0, [0, 0, 0]) } };
  parent?.children.push(made);
  return made;
}

/** A turn by `angle` about Y after one by half of it about X, then a place; column after column. */
function placed(angle, place) {
  const [c, s, d, e] = [Math.cos(angle), Math.sin(angle), Math.cos(angle / 2), Math.sin(angle / 2)];
  return [c, 0, -s, 0, s * e, d, c * e, 0, s * d, -e, c * d, 0, ...place, 1];
}

function product(a, b) {
  return Array.from({ length: 16 }, (_, i) => {
    let sum = 0;
    for (let k = 0; k < 4; k++) sum += a[4 * k + (i % 4)] * b[4 * Math.floor(i / 4) + k];
    return sum;
  });
}

/**
 * For a matrix M, 3 x 4 in row order, from clip's axes to the world that the walk is in: M times the turn of these
 * axes into the clip's, (x, -z, y). The core takes any world.
 */
function toThree(m) {
  const columns = [0, 1, 2, 3].map((column) => [m[column], m[4 + column], m[8 + column]]);
  return [...columns[0], 0, ...columns[2], 0, ...columns[1].map((value) => -value), 0, ...columns[3], 1];
}
