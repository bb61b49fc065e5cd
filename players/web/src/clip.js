import { Core, HapticError } from "./core.js";

const MODALITIES = ["vibration", "pressure", "temperature", "wind"];
const SIDES = ["any", "left", "right"];
const PLACES = ["vertices", "skin", "room"];
const SHAPES = ["cuboid", "sphere", "cylinder", "capsule"];
const NONE = 0xffffffff;

/** Sections of an opened clip (docs/formats/clip.md) as typed reads. */
class Sections {
  constructor(bytes) {
    this.view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
    this.bytes = bytes;
    this.at = new Map();
    for (let k = 0; k < this.view.getUint32(20, true); k++) {
      const entry = 24 + 16 * k;
      const name = String.fromCharCode(...bytes.subarray(entry, entry + 4));
      this.at.set(name, [this.u32(entry + 4), this.u32(entry + 8)]);
    }
  }

  u32(at) {
    return this.view.getUint32(at, true);
  }

  f32(at) {
    return this.view.getFloat32(at, true);
  }

  f64(at) {
    return this.view.getFloat64(at, true);
  }

  floats(at, count) {
    return Float32Array.from({ length: count }, (_, k) => this.f32(at + 4 * k));
  }

  /** The text whose offset in TEXT is stored at a place. */
  text(at) {
    const start = this.at.get("TEXT")[0] + this.u32(at);
    return new TextDecoder().decode(this.bytes.subarray(start, this.bytes.indexOf(0, start)));
  }

  /** One result of `read(place, index)` for each record. */
  records(name, size, read) {
    const [start, bytes] = this.at.get(name) ?? [0, 0];
    return Array.from({ length: bytes / size }, (_, k) => read(start + size * k, k));
  }
}

/** A haptic clip: what each actuator plays, and what an avatar can feel of volumes and areas. */
export class HapticClip {
  /** Fetches and opens a clip. */
  static async load(source) {
    const answer = await fetch(source);
    if (!answer.ok) throw new Error(`The haptic clip ${answer.url} could not be fetched: ${answer.status}.`);
    return HapticClip.from(await answer.arrayBuffer());
  }

  /** Opens a clip in memory, an ArrayBuffer or a view of one. Throws a HapticError. */
  static async from(bytes) {
    const content = ArrayBuffer.isView(bytes)
      ? new Uint8Array(bytes.buffer, bytes.byteOffset, bytes.byteLength)
      : new Uint8Array(bytes);
    return new HapticClip(await Core.make(), content);
  }

  constructor(core, content) {
    if (!(core instanceof Core)) throw new TypeError("Open clips by HapticClip.load or HapticClip.from.");
    const start = core.take(content.length || 1);
    core.bytes(start, content.length).set(content);
    this.core = core;
    this.content = { start, length: content.length };
    this.address = core.take(core.calls.hfx_clip_size());
    core.check(core.calls.hfx_clip_open(this.address, start, content.length));
    this.#read(new Sections(content));
  }

  #read(of) {
    const [time] = of.at.get("TIME");
    this.name = of.text(time + 20);
    this.rateHz = of.f64(time);
    this.seconds = of.u32(time + 16) / this.rateHz;
    this.devices = of.records("DEVC", 32, (at) => ({
      id: of.text(at),
      name: of.text(at + 4),
      body: of.text(at + 8),
      firstActuator: of.u32(at + 12),
      actuators: of.u32(at + 16),
      firstColumn: of.u32(at + 20),
      columns: of.u32(at + 24),
      deadManMs: of.u32(at + 28),
    }));
    this.actuators = of.records("ACTR", 88, (at) => ({
      id: of.text(at),
      modality: MODALITIES[of.u32(at + 4)],
      firstColumn: of.u32(at + 8),
      columns: of.u32(at + 12),
      place: PLACES[of.u32(at + 28)],
      side: SIDES[of.u32(at + 32)],
      parts: of.text(at + 36),
      bone: of.text(at + 40),
      humanBone: of.text(at + 44),
      centreM: [...of.floats(at + 48, 3)],
      radiusM: of.f32(at + 60),
      latencyMs: of.f32(at + 64),
      updateIntervalMs: of.f32(at + 68),
      slewPerS: of.f32(at + 72),
      maximumOnS: of.f32(at + 76),
      restS: of.f32(at + 80),
    }));
    this.columns = of.records("COLM", 40, (at) => ({
      parameter: of.text(at),
      unit: of.text(at + 4),
      actuator: of.u32(at + 8),
      lowest: of.f64(at + 16),
      highest: of.f64(at + 24),
      neutral: of.f64(at + 32),
    }));
    this.namedClips = of.records("CLIP", 24, (at) => ({
      name: of.text(at),
      loops: of.u32(at + 4) === 1,
      startS: of.f64(at + 8),
      endS: of.f64(at + 16),
    }));
    const bones = of.records("BONE", 72, (at) => ({
      name: of.text(at),
      human: of.text(at + 4),
      mixamo: of.text(at + 8),
      unreal: of.text(at + 12),
      parent: of.u32(at + 16) === NONE ? -1 : of.u32(at + 16),
      lengthM: of.f32(at + 20),
      rest: of.floats(at + 24, 12),
      hasSkin: false,
    }));
    this.bodies = of.records("BODY", 24, (at) => {
      const first = of.u32(at + 4);
      const own = bones.slice(first, first + of.u32(at + 8));
      HapticClip.#markSkin(of, own, of.u32(at + 12), of.u32(at + 16));
      return { name: of.text(at), bones: own };
    });
    this.effects = of.records("EFCT", 128, (at) => ({
      name: of.text(at),
      isPainted: of.u32(at + 4) === 1,
      modality: MODALITIES[of.u32(at + 8)],
      shape: SHAPES[of.u32(at + 20)],
      halfSegment: of.f32(at + 24),
      level: of.f32(at + 36),
      parameters: of.floats(at + 40, 4),
      matrix: of.floats(at + 76, 12),
    }));
    const maps = of.records("HMAP", 32, (at) => ({
      columns: of.u32(at),
      rows: of.u32(at + 4),
      widthMm: of.f32(at + 8),
      heightMm: of.f32(at + 12),
      tiles: of.u32(at + 16) === 1,
    }));
    this.surfaces = of.records("SURF", 32, (at) => ({
      name: of.text(at),
      ...maps[of.u32(at + 4)],
      lowestMS2: of.f32(at + 8),
      highestMS2: of.f32(at + 12),
      lowestHz: of.f32(at + 16),
      highestHz: of.f32(at + 20),
      uvWidthMm: of.f32(at + 24),
      uvHeightMm: of.f32(at + 28),
    }));
  }

  /** Sets `hasSkin` of the bones that move a vertex of the body's models. */
  static #markSkin(of, bones, firstModel, models) {
    const [starts] = of.at.get("MODL") ?? [0];
    const [vertices] = of.at.get("VERT") ?? [0];
    const [weights] = of.at.get("WGHT") ?? [0];
    for (let k = firstModel; k < firstModel + models; k++) {
      const first = of.u32(starts + 24 * k + 12);
      for (let v = first; v < first + of.u32(starts + 24 * k + 16); v++) {
        const at = vertices + 24 * v;
        for (let w = of.u32(at + 16); w < of.u32(at + 16) + of.u32(at + 20); w++)
          if (of.view.getUint16(weights + 4 * w + 2, true)) bones[of.view.getUint16(weights + 4 * w, true)].hasSkin = true;
      }
    }
  }

  /** One number for each column: its value while nothing is felt. */
  neutralValues() {
    return Float32Array.from(this.columns, (column) => column.neutral);
  }
}

/** Raised for a name that the clip does not have; names those that it has. */
export function unknownName(kind, name, known) {
  const list = known.length ? `it has: ${known.join(", ")}` : "it has none";
  return new HapticError(`The clip has no ${kind} '${name}'; ${list}.`, -7);
}
