// Judges of the package, for Node and for browsers. SPDX-License-Identifier: MIT

const STEP = 1 / 65535;
const ROUNDING = 1e-6; // of numbers in 32 bits

/**
 * Plays a clip of players/conformance by its calls; numbers compared and sentences about wrong ones. `watch` makes
 * a function for a player, which gets each frame's seconds, expected values, and a name of the line.
 */
export async function judgeClip(hfx, bytes, text, name, watch = () => () => {}) {
  const clip = await hfx.HapticClip.from(bytes);
  const player = new hfx.HapticPlayer(clip);
  const watched = watch(player);
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
      watched(Number(argument), expected.split(" ").map(Number), `${name}, line ${number + 1}`);
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

/** Plays a script of players/conformance/behaviour, whose results were calculated by hand. */
export async function judgeBehaviour(hfx, bytes, text) {
  const clip = await hfx.HapticClip.from(bytes);
  const result = { compared: 0, wrong: [] };
  let player = new hfx.HapticPlayer(clip);
  const calls = {
    open: () => (player = new hfx.HapticPlayer(clip)),
    play: (name) => isDone(() => player.play(name)),
    parameter: (name, factor) => (player.setParameter(name, Number(factor)) ? "" : 0),
    playing: () => Number(player.isPlaying),
    position: () => player.position,
    devices: (name = "") => clip.devices.flatMap(({ id }, k) => (hfx.isDevice(id, name) ? [k] : [])).join(" "),
    advance: (seconds) => [...player.advance(Number(seconds))].join(" "),
    silence: () => (player.pause(), [...player.values].join(" ")),
    pause: (is) => player.pause(is === "1"),
    stop: () => player.stop(),
    seek: (seconds) => player.seek(Number(seconds)),
    place: (...numbers) => player.place(...numbers.map(Number)),
    loop: (loop) => (player.loop = loop === "1"),
    gain: (gain) => (player.gain = Number(gain)),
  };
  text.split("\n").forEach((line, number) => {
    if (!line || line.startsWith("#")) return;
    const [call, expected] = line.split("=").map((part) => part.trim());
    const [word, ...rest] = call.split(" ");
    const found = calls[word](...(word === "play" ? [rest.join(" ")] : rest));
    result.compared += 1;
    const numbers = String(found).split(" ").map(Number);
    const slack = word === "advance" || word === "silence" ? 0.003 : 1e-6; // 2/65535 of a column of 65.535
    const isRight = word === "parameter" || expected === undefined
      ? expected === undefined ? word !== "parameter" || found === "" : String(found) === expected
      : expected.split(" ").length === numbers.length && expected.split(" ").every((value, k) => Math.abs(numbers[k] - Number(value)) <= slack);
    if (!isRight) result.wrong.push(`behaviour, line ${number + 1}: ${line}: ${found}`);
  });
  return result;
}

/** Effects of a library on the body of another clip. */
export async function judgeEffects(hfx, avatar, library, text) {
  const [clip, effects] = [await hfx.HapticClip.from(avatar), await hfx.HapticClip.from(library)];
  const result = { compared: 0, wrong: [] };
  const numbered = (name) => effects.effects.findIndex((item) => item.name === name);
  const sphere = (x, y, z, radius) => [radius, 0, 0, x, 0, radius, 0, y, 0, 0, radius, z];
  const three = (x, y, z, radius) => ({ matrixWorld: { elements: [radius, 0, 0, 0, 0, radius, 0, 0, 0, 0, radius, 0, x, y, z, 1] } });
  let body = null;
  const { warn } = console;
  const warned = [];
  console.warn = (message) => warned.push(message);
  const calls = {
    open: () => {
      body = new hfx.HapticBody(clip, { effects });
      body.setBones(sphere(0, 0, 0, 1));
    },
    evaluate: (seconds) => [...body.evaluate(Number(seconds))].join(" "),
    trigger: (name, factor) => isDone(() => body.trigger(name, Number(factor))),
    place: (name, ...numbers) => isDone(() => body.place(name, ...numbers.map(Number))),
    volume: (name, ...numbers) =>
      isDone(() => {
        body.setVolume(numbered(name), sphere(...numbers.map(Number)));
        body.triggerEffect(numbered(name), 1);
      }),
    add: (name, ...numbers) =>
      isDone(() => {
        const volume = body.addVolume(name, three(0, 0, 0, 1));
        body.setVolume(volume.numbers[0], sphere(...numbers.map(Number)));
        body.triggerEffect(volume.numbers[0], 1);
      }),
  };
  text.split("\n").forEach((line, number) => {
    if (!line || line.startsWith("#")) return;
    const [call, expected] = line.split("=").map((part) => part.trim());
    const [word, ...rest] = call.split(" ");
    if (word === "trigger" && rest[0] === "Ball") {
      body.triggerEffect(numbered("Ball"), Number(rest[1])); // a volume is an object's
      return;
    }
    const found = calls[word](...rest);
    result.compared += 1;
    const numbers = String(found).split(" ").map(Number);
    const isRight = expected === undefined || expected.split(" ").every((value, k) => Math.abs(numbers[k] - Number(value)) <= 1e-4);
    if (!isRight) result.wrong.push(`effects, line ${number + 1}: ${line}: ${found}`);
  });

  result.compared += 1;
  if (!/ feel Heat: /.test(warned[0])) result.wrong.push(`effects: warned of ${warned}`);

  // Two libraries on one avatar: a body for each, and the stronger of both on an output.
  const both = [new hfx.HapticBody(clip, { effects }), new hfx.HapticBody(clip, { effects })];
  both.forEach((each) => each.setBones(sphere(0, 0, 0, 1)));
  both[0].trigger("Dot");
  both[1].trigger("Dot", 0.5);
  both.forEach((each) => each.evaluate(0.02));
  console.warn = warn;
  const strongest = new hfx.XRHaptics({ inputSources: [] }, both).strongest("any").share;
  result.compared += 1;
  if (Math.abs(strongest - 5 / 65.535) > 1e-5) result.wrong.push(`two bodies: ${strongest}`);
  return result;
}

/**
 * Speed and following. Rows of behaviour.hfxclip have 1 to 10 at the first column, 0.1 s each; Strike is 0.2 to 0.5 s.
 * What is followed is a stub, or with `three` an action of an AnimationMixer.
 */
export async function judgeFollowing(hfx, bytes, three = null) {
  const player = new hfx.HapticPlayer(await hfx.HapticClip.from(bytes));
  const result = { compared: 0, wrong: [] };
  const expect = (value, place) => {
    result.compared += 1;
    const found = player.values[0];
    if (!(Math.abs(found - value) < 0.003)) result.wrong.push(`following, ${place}: ${found} instead of ${value}`);
  };
  player.play();
  player.speed = 2;
  player.advance(0.1);
  expect(3, "twice as fast");
  player.speed = NaN;
  player.advance(5);
  expect(3, "a speed that is no number stands still");
  player.speed = 1;

  // name, length, loops, time, value; Walk is no named clip, and longer than the whole one. "": it is paused.
  const moments = [
    ["Strike", 0.3, false, 0, 3], ["Strike", 0.3, false, 0.05, 3], ["Strike", 0.3, false, 0.15, 4], ["Strike", 0.3, false, 0.299, 5],
    ["Strike", 0.3, false, 0.05, 3], // set back by the game
    ["", 0.3, false, 0.15, 0], ["Strike", 0.3, false, 0.25, 5],
    ["Walk", 2, true, 0.25, 3], ["Walk", 2, true, 0.45, 5], ["Walk", 2, true, 0.85, 9], ["Walk", 2, true, 1.2, 10], ["Walk", 2, true, 1.4, 0],
    ["Walk", 2, true, 0.25, 3], // it has begun again
    ["Whole", 1, true, 0.85, 9], ["Whole", 1, true, 0.95, 10], ["Whole", 1, true, 0.15, 2], ["Whole", 1, true, 0.95, 10],
  ];
  const media = { name: "", currentTime: 0, duration: 1, loop: false, paused: true };
  player.follow = media;
  for (const [name, duration, loop, currentTime, value] of moments) {
    Object.assign(media, { duration, loop, currentTime, paused: !name });
    if (name) media.name = name;
    player.advance(99); // what is followed has a time of its own
    expect(value, `${name} at ${currentTime} s`);
  }
  player.follow = null;
  player.advance(0.1);
  expect(0, "nothing is followed");
  player.play();
  player.advance(0.25);
  expect(3, "it plays by itself again");
  if (!three) return result;

  const mixer = new three.AnimationMixer(new three.Object3D());
  const track = new three.NumberKeyframeTrack(".position[x]", [0, 0.3], [0, 1]);
  const action = mixer.clipAction(new three.AnimationClip("Strike", 0.3, [track]));
  player.follow = action;
  player.advance(0.1);
  expect(0, "an action that does not play");
  action.setLoop(three.LoopRepeat, Infinity).play();
  for (const [seconds, value] of [[0, 3], [0.15, 4], [0.1, 5], [0.1, 3], [0.15, 5]]) {
    mixer.update(seconds);
    player.advance(seconds);
    expect(value, `an action after ${seconds} s`);
  }
  action.timeScale = 0.5;
  mixer.update(0.1); // from 0.2 to 0.25 s
  player.advance(0.1);
  expect(5, "a slow action");
  action.stop();
  player.advance(0.1);
  expect(0, "an action that was stopped");
  return result;
}

function isDone(call) {
  try {
    call();
    return 1;
  } catch {
    return 0;
  }
}

/**
 * Walks the body of players/conformance/spatial. With `posed`, bones are objects as of three.js with axes of their
 * own and names as its loaders spell them, and volumes follow objects. With `three`, they are objects of three.js.
 */
export async function judgeWalk(hfx, bytes, text, posed, three = null) {
  const clip = await hfx.HapticClip.from(bytes);
  const body = new hfx.HapticBody(clip);
  const bones = new Float32Array(12 * body.bones.length);
  const scene = posed ? new Skeleton(body, three) : null;
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
  constructor(body, three = null) {
    this.body = body;
    this.three = three;
    this.volumes = [];
    this.objects = [];
    const root = this.node("Avatar", null);
    const armature = this.node("Armature", root, placed(7, [0.3, -0.2, 0.5]));
    this.own = body.bones.map((_, k) => placed(k + 1, [0.1 * k, 0.02 * k, -0.05 * k]));
    // At rest a bone stands somewhere in the armature's space, on axes of its own.
    this.bones = [];
    body.bones.forEach(({ name, parent }, k) => {
      const world = product(placed(7, [0.3, -0.2, 0.5]), this.own[k]);
      const spelt = three ? three.PropertyBinding.sanitizeNodeName(name) : name.replace(/[.:]/g, "");
      this.bones.push(this.node(spelt, parent < 0 ? armature : this.bones[parent], world, true));
    });
    this.forget();
    body.attach(root);
    if (body.missing.length) throw new Error(`missing: ${body.missing}`);
  }

  node(name, parent, world = placed(0, [0, 0, 0]), isBone = false) {
    const { three } = this;
    const made = three
      ? Object.assign(isBone ? new three.Bone() : new three.Object3D(), { name, matrixAutoUpdate: false })
      : { name, parent, isBone, children: [], matrixWorld: { elements: world } };
    if (three) parent?.add(made);
    else parent?.children.push(made);
    this.objects.push(made);
    this.move(made, world);
    return made;
  }

  /** Moves an object, its parents being where they shall be. */
  move(object, world) {
    if (!this.three) {
      object.matrixWorld.elements = world;
      return;
    }
    object.matrix.fromArray(world);
    if (object.parent) object.matrix.premultiply(object.parent.matrixWorld.clone().invert());
    object.matrixWorld.fromArray(world);
  }

  /** Outdates world matrices of three.js, which the package has to update. */
  forget() {
    if (!this.three) return;
    for (const object of this.objects) {
      object.matrixWorld.identity();
      object.matrixWorldNeedsUpdate = true;
    }
  }

  /** Bone K, whose rest space moved by M (clip's axes): M in these axes, then its place at rest. */
  pose(matrices) {
    if (this.three) this.objects[0].updateMatrixWorld(true);
    this.bones.forEach((bone, k) => {
      this.move(bone, product(toThree(matrices.subarray(12 * k, 12 * k + 12)), this.own[k]));
    });
    this.forget();
  }

  volume(effect) {
    return this.body.addVolume(effect, this.node("volume", null));
  }

  place(effect, level, matrix) {
    this.volumes[effect] ??= this.volume(this.body.clip.effects[effect].name);
    this.volumes[effect].level = level;
    this.move(this.volumes[effect].object, toThree(matrix));
    this.forget();
  }
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

/** Judges the whole folder; `read(name)` gives bytes of a file, `names` are its .txt files; `three`: or null. */
export async function judgeAll(hfx, names, read, three = null) {
  const text = async (name) => new TextDecoder().decode(await read(name));
  const clips = [];
  for (const name of names) {
    const clip = name.replace(".txt", ".hfxclip");
    clips.push(await judgeClip(hfx, await read(clip), await text(name), clip));
  }
  const behaviour = await judgeBehaviour(hfx, await read("behaviour/behaviour.hfxclip"), await text("behaviour/behaviour.txt"));
  const hand = async (name) => read(`behaviour/${name}.hfxclip`);
  const placed = await judgeBehaviour(hfx, await hand("ring"), await text("behaviour/placed.txt"));
  const effects = await judgeEffects(hfx, await hand("avatar"), await hand("library"), await text("behaviour/effects.txt"));
  const following = await judgeFollowing(hfx, await hand("behaviour"), three);
  const walk = [await read("spatial/walk.hfxclip"), await text("spatial/walk.txt")];
  const walks = [await judgeWalk(hfx, ...walk, false), await judgeWalk(hfx, ...walk, true)];
  if (three) walks.push(await judgeWalk(hfx, ...walk, true, three));
  const pulses = await judgePulses(hfx, await read("touch.hfxclip"), await text("touch.txt"));
  const strokes = await judgeStrokes(hfx, await read("surfaces/strokes.hfxclip"), await text("surfaces/strokes.txt"));
  const rigs = await judgeNames(hfx, walk[0]);
  const all = [...clips, behaviour, placed, effects, following, ...walks, pulses, strokes, rigs];
  const wrong = all.flatMap((result) => result.wrong);
  if (all.some((result) => !result.compared)) wrong.push("something was not compared");
  const values = clips.reduce((sum, result) => sum + result.compared, 0);
  const summary =
    `${clips.length} clips, ${values} values, ${behaviour.compared + placed.compared + effects.compared + following.compared} calls, ` +
    `${walks.map((result) => result.compared).join(", ")} weights, ${strokes.compared} touches, ${pulses.compared} pulses, ${wrong.length} wrong`;
  return { wrong, summary };
}
/**
 * Sends touch.hfxclip (two controllers, strengths up to 10 m/s², dead-man time 250 ms) to stubs of the browser's
 * interfaces. Planned is, for the strengths in the folder's text: left 0 and right 1 of each frame over 10, for
 * 250 ms; after the last of them one of nothing for 10 ms. The phone's motor is on for the larger share of 20 ms.
 */
export async function judgePulses(hfx, bytes, text) {
  const calls = { gamepad: [], phone: [], left: [], right: [] };
  const gamepad = { index: 0, vibrationActuator: { playEffect: async (...effect) => calls.gamepad.push(effect) } };
  const inputSources = ["left", "right"].map((handedness) => ({
    handedness,
    gamepad: { hapticActuators: [{ pulse: async (...pulse) => calls[handedness].push(pulse) }] },
  }));
  stub("getGamepads", () => [null, gamepad]);
  stub("vibrate", (pattern) => calls.phone.push(pattern) > 0);
  const result = { compared: 0, wrong: [] };
  const isOn = { gamepad: false, left: false, right: false };
  let [onMs, nowMs, againMs] = [0, 0, 0];
  const expect = (name, planned, place) => {
    const found = calls[name].splice(0);
    result.compared += planned.length;
    if (!isNear(found, planned))
      result.wrong.push(`${place}, ${name}: ${JSON.stringify(found)} instead of ${JSON.stringify(planned)}`);
  };
  const expectPulse = (name, isNow, strong, silent, place) => {
    expect(name, isNow ? [strong] : isOn[name] ? [silent] : [], place);
    isOn[name] = isNow;
  };
  const rumble = (duration, strongMagnitude, weakMagnitude) => ["dual-rumble", { startDelay: 0, duration, strongMagnitude, weakMagnitude }];

  const watch = (player) => {
    const phone = new hfx.PhoneHaptics(player);
    const outputs = [
      new hfx.GamepadHaptics(player, { device: "oculus_touch" }),
      new hfx.XRHaptics({ inputSources }, player),
      new hfx.GamepadHaptics(player, { index: 7 }), // of which there is none
      new hfx.XRHaptics({ inputSources }, player, { device: "back_pad" }), // not in the clip
      phone,
    ];
    return (seconds, values, place) => {
      nowMs += 1000 * seconds;
      for (const output of outputs) output.send(nowMs);
      const [left, right] = [values[0] / 10, values[2] / 10];
      expectPulse("gamepad", left > 0 || right > 0, rumble(250, left, right), rumble(10, 0, 0), place);
      expectPulse("left", left > 0, [left, 250], [0, 10], place);
      expectPulse("right", right > 0, [right, 250], [0, 10], place);
      // 12 cycles of 20 ms fit into 250 ms; the last pause is left out, and after half of them it is given again.
      const share = Math.max(left, right);
      const nextMs = share > 0 ? Math.max(Math.round(20 * share), 1) : 0;
      const cycles = Array(12).fill([nextMs, 20 - nextMs]).flat().slice(0, -1);
      const isGiven = nextMs !== onMs || (nextMs > 0 && nowMs >= againMs);
      expect("phone", isGiven ? [nextMs === 0 ? 0 : nextMs === 20 ? [240] : cycles] : [], place);
      if (isGiven) againMs = nowMs + 120;
      onMs = nextMs;
    };
  };
  const { wrong } = await judgeClip(hfx, bytes, text, "touch.hfxclip", watch);
  result.wrong.push(...wrong);
  return result;
}

/**
 * Strokes over the surfaces of players/conformance/surfaces, then a pointer on an element: amplitudes within 1/255
 * of the highest, frequencies within 1 Hz.
 */
export async function judgeStrokes(hfx, bytes, text) {
  const clip = await hfx.HapticClip.from(bytes);
  const result = { compared: 0, wrong: [] };
  let surface = null;
  for (const line of text.split("\n")) {
    const [word, u, v, seconds, , amplitude, hertz] = line.split(" ");
    if (word === "surface") surface = new hfx.HapticSurface(clip, clip.surfaces[Number(u)].name);
    if (word !== "feel") continue;
    surface.touch(Number(u), Number(v));
    const [a, f] = surface.advance(Number(seconds));
    result.compared += 1;
    const isRight = Math.abs(a - Number(amplitude)) <= surface.surface.highestMS2 / 255 && (hertz === undefined || Math.abs(f - Number(hertz)) <= 1);
    if (!isRight) result.wrong.push(`strokes, ${line}: ${a} ${f}`);
  }

  // The same stroke by a pointer on an element of 200 x 100 pixels, and by places.
  const element = new EventTarget();
  element.getBoundingClientRect = () => ({ left: 50, top: 20, width: 200, height: 100 });
  const [pointed, touched] = [new hfx.HapticSurface(clip), new hfx.HapticSurface(clip)];
  const end = pointed.follow(element, { repeat: [2, 1] });
  const point = (name, clientX, clientY, pointerId = 1) =>
    element.dispatchEvent(Object.assign(new Event(name), { clientX, clientY, pointerId, button: name === "pointermove" ? -1 : 0 }));
  const expect = (amplitude, place) => {
    result.compared += 1;
    if (pointed.advance(0.01)[0] !== amplitude) result.wrong.push(`pointer, ${place}: ${pointed.values[0]} instead of ${amplitude}`);
  };
  const places = (...uv) => {
    for (let k = 0; k < uv.length; k += 2) touched.touch(uv[k], uv[k + 1]);
    return touched.advance(0.01)[0];
  };
  point("pointermove", 60, 30);
  expect(0, "not pressed");
  point("pointerdown", 100, 70);
  expect(places(0.5, 0.5), "down");
  point("pointermove", 200, 45);
  point("pointermove", 250, 30, 2); // a second finger
  point("pointermove", 210, 95);
  expect(places(1.5, 0.75, 1.6, 0.25), "moved");
  if (!(pointed.values[0] > 0)) result.wrong.push("the pointer feels nothing");
  expect(places(), "holds for a moment");
  for (let k = 0; k < 6; k++) pointed.advance(0.01);
  expect(0, "rests");
  point("pointermove", 251, 95);
  point("pointermove", 150, 95);
  expect(0, "has left the element");
  point("pointerdown", 100, 70);
  pointed.advance(0.01);
  point("pointermove", 200, 45);
  point("pointerup", 200, 45);
  expect(0, "up");
  end();
  point("pointerdown", 100, 70);
  pointed.advance(0.01);
  point("pointermove", 200, 45);
  expect(0, "ended");

  // Outputs play a surface as a share of its full amplitude.
  const strong = new hfx.HapticSurface(clip, "", { fullMS2: 2 * clip.surfaces[0].highestMS2, side: "left" });
  strong.touch(0.5, 0.5);
  strong.advance(0.01);
  strong.touch(0.9, 0.8);
  const share = strong.advance(0.01)[0] / strong.vibrations[0].highest;
  const pulse = new hfx.XRHaptics({ inputSources: [] }, [strong]).strongest("left");
  if (!(share > 0 && share <= 0.5) || Math.abs(pulse.share - share) > 1e-6 || pulse.milliseconds !== 100) result.wrong.push(`surface: ${share}, ${pulse.share}`);
  return result;
}

/** Attaches skeletons with names of other rigs: exactly the bones that have no name there are missing. */
export async function judgeNames(hfx, bytes) {
  const clip = await hfx.HapticClip.from(bytes);
  const capital = (name) => name && name[0].toUpperCase() + name.slice(1);
  const sided = (human) => human.replace(/^left(.*)/, "$1_L").replace(/^right(.*)/, "$1_R");
  const spellings = {
    mixamo: (bone) => bone.mixamo && `mixamorig:${bone.mixamo}`,
    loaded: (bone) => bone.mixamo && `mixamorig1${bone.mixamo}`, // as three.js spells it
    unreal: (bone) => bone.unreal,
    vrm: (bone) => bone.human,
    godot: (bone) => capital(bone.human),
    vroid: (bone) => bone.human && `J_Bip_${/^left/.test(bone.human) ? "L_" : /^right/.test(bone.human) ? "R_" : "C_"}${bone.human.replace(/^(left|right)/, "")}`,
    sides: (bone) => sided(bone.human),
    rigify: (bone) => `DEF-${bone.name}`,
    namespace: (bone) => `Avatar:${bone.name}`,
  };
  const result = { compared: 0, wrong: [] };
  const { warn } = console;
  console.warn = () => {};
  for (const [rig, spell] of Object.entries(spellings)) {
    const body = new hfx.HapticBody(clip);
    const root = { name: "Avatar", parent: null, children: [], matrixWorld: { elements: placed(0, [0, 0, 0]) } };
    for (const name of new Set(body.bones.map(spell))) if (name) root.children.push({ ...root, name, parent: root, children: [], isBone: true });
    body.attach(root);
    const planned = body.bones.filter((bone) => bone.hasSkin && !spell(bone)).map((bone) => bone.name);
    result.compared += body.bones.length;
    if (String(body.missing) !== String(planned)) result.wrong.push(`${rig}: missing are ${body.missing} instead of ${planned}`);
  }
  console.warn = warn;
  return result;
}

/** Compares index.d.ts with the package: its exports, and the members of its classes. */
export async function judgeTypes(hfx, declarations, bytes, surfaces) {
  const clip = await hfx.HapticClip.from(bytes);
  const body = new hfx.HapticBody(clip);
  const scene = new Skeleton(body);
  const sources = [new hfx.HapticPlayer(clip), body];
  const objects = [
    ...sources, clip, scene.volume(clip.effects[0].name), new hfx.HapticError("", -1), new hfx.GamepadHaptics(sources),
    new hfx.PhoneHaptics(sources), new hfx.HapticSurface(await hfx.HapticClip.from(surfaces)), new hfx.XRHaptics({ inputSources: [] }, sources),
  ];
  const result = { compared: 0, wrong: [] };
  const declared = [...declarations.matchAll(/^export (?:class|function) (\w+)/gm)].map((found) => found[1]).sort();
  if (String(declared) !== String(Object.keys(hfx).sort())) result.wrong.push(`exports: ${Object.keys(hfx)}`);
  for (const [, name, members] of declarations.matchAll(/^export class (\w+)[^{]*\{\n(.*?)^\}/gms)) {
    const object = objects.find((item) => item.constructor === hfx[name]) ?? hfx[name].prototype;
    for (const [, isStatic, member] of members.matchAll(/^  (static )?(?:readonly )?(\w+)\??[(:]/gm)) {
      result.compared += 1;
      const isField = name === "HapticLoop" && ["sources", "outputs"].includes(member); // made with a document only
      if (member !== "constructor" && !isField && !(member in (isStatic ? hfx[name] : object))) result.wrong.push(`${name} has no ${member}`);
    }
  }
  return result;
}

/** A page in a frame with focus, and the patterns that it gives to a stub of navigator.vibrate. */
async function opened(address) {
  const frame = document.createElement("iframe");
  const patterns = [];
  frame.src = address;
  document.body.append(frame);
  await new Promise((resolve) => (frame.onload = resolve));
  const { contentDocument, contentWindow } = frame;
  contentDocument.hasFocus = () => true; // a browser without a window has none
  Object.defineProperty(contentWindow.navigator, "vibrate", { value: (pattern) => patterns.push([pattern].flat()) > 0 });
  await wait(300);
  return { frame, patterns, contentDocument, contentWindow };
}

function wait(milliseconds) {
  return new Promise((resolve) => setTimeout(resolve, milliseconds));
}

/**
 * Strokes the board's page from its second square into the third, with a finger: both vibrate, and nothing does
 * before and after.
 */
export async function judgeBoard(address) {
  const { frame, patterns, contentDocument, contentWindow } = await opened(address);
  const result = { compared: 0, wrong: [] };
  const squares = [...contentDocument.querySelectorAll("#board div")];
  if (squares.length !== 16) result.wrong.push(`the board has ${squares.length} squares`);
  const point = (name, square, share, buttons = 1) => {
    const { left, top, width, height } = square.getBoundingClientRect();
    const place = { clientX: left + share * width, clientY: top + (0.3 + 0.4 * share) * height };
    const event = { ...place, pointerId: 5, buttons, button: name === "pointerdown" ? 0 : -1, pointerType: "touch" };
    square.dispatchEvent(new contentWindow.PointerEvent(name, event));
  };
  for (const [square, name] of [[squares[1], "pointerdown"], [squares[2], "pointerenter"]]) {
    patterns.length = 0;
    point(name, square, 0.05);
    for (let share = 0.1; share < 1; share += 0.05) {
      point("pointermove", square, share);
      await wait(20);
    }
    result.compared += patterns.length;
    if (!patterns.some((pattern) => pattern[0] > 0)) result.wrong.push(`${square.textContent} does not vibrate`);
    point("pointerleave", square, 1, 0);
  }
  await wait(200);
  if (String(patterns.at(-1)) !== "0") result.wrong.push("the board vibrates after the touch");
  frame.remove();
  return result;
}

/** Faults of the garage's axis of seconds: labels at their times, an arrow from 2.5 s to 3 s, nothing before. */
function wrongAxis(page) {
  const wrong = [];
  const labels = [...page.querySelectorAll("#time span")];
  const [, second] = labels;
  const width = parseFloat(second?.style.left);
  if (labels[0]?.textContent !== "0 s" || second?.textContent !== "1") wrong.push("the garage's axis has no seconds");
  if (labels.some((label, k) => Math.abs(parseFloat(label.style.left) - k * width) > 0.01)) wrong.push("the garage's seconds are uneven");
  const points = page.querySelector("#time path").getAttribute("d").slice(1).split("L").map((text) => text.split(" ").map(Number));
  const strongest = (from, to) => Math.max(...points.filter(([x]) => x > from * width / 100 && x < to * width / 100).map(([, y]) => 1 - y));
  if (strongest(0, 2.4) > 0 || strongest(2.5, 3) < 0.1) wrong.push("the garage's curve has no arrow at 2.5 s");
  return wrong;
}

/**
 * Plays the page of the garage for 8 s: patterns begin after the button is pressed, none lasts longer than its
 * dead-man time, and the last of a page without focus is silence.
 */
export async function judgeGarage(address) {
  const { frame, patterns, contentDocument, contentWindow } = await opened(address);
  const result = { compared: 0, wrong: [] };
  if (patterns.length) result.wrong.push("the garage vibrates before its button is pressed");
  result.wrong.push(...wrongAxis(contentDocument));
  contentDocument.getElementById("play").click();
  await wait(8000);
  contentDocument.hasFocus = () => false;
  contentWindow.dispatchEvent(new Event("blur"));
  await wait(100);
  result.compared = patterns.length;
  const isLong = patterns.some((pattern) => pattern.reduce((sum, part) => sum + part, 0) > 250);
  const isStrange = patterns.some((pattern) => pattern.some((part) => !(part >= 0 && part <= 250)) || pattern.length > 99);
  if (!patterns.some((pattern) => pattern[0] > 0)) result.wrong.push("the garage does not vibrate");
  if (isLong || isStrange) result.wrong.push(`the garage gives strange patterns: ${JSON.stringify(patterns.slice(0, 9))}`);
  if (patterns.length && String(patterns.at(-1)) !== "0") result.wrong.push("the garage vibrates without focus");
  if (!/^\d+\.\d of \d+\.\d s/.test(contentDocument.getElementById("text").textContent)) result.wrong.push("the garage shows no time");
  frame.remove();
  return result;
}

/**
 * Plays touch.hfxclip in a session of three.js' renderer in iwer's headset: each frame the pulses that its
 * values ask for, silence while the headset shows something else and when the session ends.
 */
export async function judgeHeadset(hfx, three, iwer, bytes) {
  const headset = new iwer.XRDevice(iwer.metaQuest3);
  headset.installRuntime({ forceInstall: true });
  const renderer = new three.WebGLRenderer();
  renderer.xr.enabled = true;
  const session = await navigator.xr.requestSession("immersive-vr", { optionalFeatures: ["local-floor"] });
  await renderer.xr.setSession(session);
  const player = new hfx.HapticPlayer(await hfx.HapticClip.from(bytes));
  const loop = new hfx.HapticLoop(player, new hfx.XRHaptics(session, player));
  loop.session = session;
  player.loop = true;
  player.play();
  const result = { compared: 0, wrong: [] };
  const pulses = { left: [], right: [] };
  const isOn = { left: false, right: false };
  let frames = 0;
  renderer.setAnimationLoop((time) => {
    if (!loop.session) return; // three.js draws on the page when the session has ended
    for (const { handedness, gamepad } of session.inputSources) // the same actuator each frame
      gamepad.hapticActuators[0].pulse = async (...pulse) => pulses[handedness].push(pulse);
    loop.frame(time);
    frames += 1;
    ["left", "right"].forEach((side, k) => {
      const share = player.values[2 * k] / 10;
      const planned = share > 0 ? [[share, 250]] : isOn[side] ? [[0, 10]] : [];
      const found = pulses[side].splice(0);
      isOn[side] = share > 0;
      result.compared += planned.length;
      if (!isNear(found, planned)) result.wrong.push(`headset, ${side}: ${JSON.stringify(found)} instead of ${JSON.stringify(planned)}`);
    });
  });
  await wait(1500);
  if (frames < 10 || !(player.position > 0)) result.wrong.push(`the headset showed ${frames} frames`);
  headset.updateVisibilityState("visible-blurred");
  await wait(300);
  const position = player.position;
  await wait(300);
  if (player.position !== position || player.values.some((value, k) => value !== player.clip.columns[k].neutral))
    result.wrong.push("the player goes on while the headset shows something else");
  headset.updateVisibilityState("visible");
  await wait(500);
  if (player.position === position) result.wrong.push("the player does not go on");
  await session.end();
  if (loop.session || player.values[0] !== 0) result.wrong.push("the end of the session is not silent");
  return result;
}

function stub(name, value) {
  globalThis.navigator ??= {}; // in Node
  Object.defineProperty(navigator, name, { value, configurable: true });
}

function isNear(a, b) {
  if (typeof a === "number" && typeof b === "number") return Math.abs(a - b) <= 2e-5;
  if (typeof a !== "object" || typeof b !== "object") return a === b;
  const names = Object.keys(a);
  return names.length === Object.keys(b).length && names.every((name) => isNear(a[name], b[name]));
}
