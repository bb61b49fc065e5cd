// SPDX-License-Identifier: MIT
// Structural types: objects of three.js, sessions of WebXR and gamepads fit without their packages.

export interface Device {
  id: string;
  name: string;
  /** Name of the body that wears the device. */
  body: string;
  firstActuator: number;
  actuators: number;
  firstColumn: number;
  columns: number;
  /** Milliseconds without a new value after which an output has to be silent. */
  deadManMs: number;
}

export type Modality = "vibration" | "pressure" | "temperature" | "wind";
export type Side = "any" | "left" | "right";
export type Shape = "cuboid" | "sphere" | "cylinder" | "capsule";

export interface Actuator {
  id: string;
  modality: Modality;
  /** The first column is the strength. */
  firstColumn: number;
  columns: number;
  place: "vertices" | "skin" | "room";
  side: Side;
  /** Parts of the body, separated by commas. */
  parts: string;
  bone: string;
  humanBone: string;
  /** In the rest space of the canonical body, metres. */
  centreM: [number, number, number];
  radiusM: number;
  /** Applied already. */
  latencyMs: number;
  updateIntervalMs: number;
  slewPerS: number;
  maximumOnS: number;
  restS: number;
}

export interface Column {
  /** For example `amplitude_m_s2` or `frequency_hz`. */
  parameter: string;
  unit: string;
  actuator: number;
  lowest: number;
  highest: number;
  /** Value while nothing is felt. */
  neutral: number;
}

export interface NamedClip {
  name: string;
  loops: boolean;
  startS: number;
  endS: number;
}

export interface ClipBone {
  name: string;
  /** Names of VRM 1.0, Mixamo and Unreal; may be empty. */
  human: string;
  mixamo: string;
  unreal: string;
  /** Index in the body; -1: none. */
  parent: number;
  lengthM: number;
  /** Bone to rest space, 3 x 4, row after row, in the clip's axes. */
  rest: Float32Array;
  /** Whether the bone moves a vertex. */
  hasSkin: boolean;
}

export interface Effect {
  name: string;
  isPainted: boolean;
  modality: Modality;
  shape: Shape;
  halfSegment: number;
  level: number;
  parameters: Float32Array;
  /** Shape space to world, 3 x 4, row after row, in the clip's axes. */
  matrix: Float32Array;
}

export interface Surface {
  name: string;
  /** Of the map, which is as many texels wide and high. */
  columns: number;
  rows: number;
  widthMm: number;
  heightMm: number;
  /** Of 1 in the object's texture coordinates; 0: it has none. */
  uvWidthMm: number;
  uvHeightMm: number;
  /** Whether the map repeats beyond its border. */
  tiles: boolean;
  /** Peak amplitude at intensity 0 and 1, m/s². */
  lowestMS2: number;
  highestMS2: number;
  /** At sharpness 0 and 1. */
  lowestHz: number;
  highestHz: number;
}

/** An error of the clip or the core; `code` is an `hfx_error` of `hfx_player.h`. */
export class HapticError extends Error {
  readonly code: number;
  constructor(message: string, code: number);
}

/** A haptic clip. Any number of players and bodies can use one. */
export class HapticClip {
  private constructor();
  /** Fetches and opens a clip. */
  static load(source: string | URL | Request): Promise<HapticClip>;
  /** Opens a clip in memory. Throws a `HapticError`. */
  static from(bytes: ArrayBuffer | ArrayBufferView): Promise<HapticClip>;
  readonly name: string;
  readonly rateHz: number;
  readonly seconds: number;
  readonly devices: readonly Device[];
  readonly actuators: readonly Actuator[];
  readonly columns: readonly Column[];
  readonly namedClips: readonly NamedClip[];
  readonly bodies: readonly { name: string; bones: readonly ClipBone[] }[];
  readonly effects: readonly Effect[];
  readonly surfaces: readonly Surface[];
  /** One number for each column: its value while nothing is felt. */
  neutralValues(): Float32Array;
}

/** Gives values each frame: one for each column of a clip, or of a surface amplitude and frequency. */
export interface HapticSource {
  readonly clip: HapticClip;
  /** Values of the last frame, in the units of the columns; always the same array. */
  readonly values: Float32Array;
  /** Goes on by seconds; returns `values`. */
  advance(seconds: number): Float32Array;
  /** Makes all values neutral until the next `advance`; returns `values`. */
  silence(): Float32Array;
}

/** Plays a clip: each frame, of each actuator, the strongest row since the last frame. */
export class HapticPlayer implements HapticSource {
  constructor(clip: HapticClip);
  readonly clip: HapticClip;
  readonly values: Float32Array;
  /** Scales how far all strengths are from neutral; 1 at first. */
  gain: number;
  /** Whether the whole clip, and what plays now, begins again at its end; false at first. */
  loop: boolean;
  /** Called when the clip comes to its end by itself. */
  onfinished: (() => void) | null;
  readonly isPlaying: boolean;
  readonly isPaused: boolean;
  /** Seconds of the clip in a second; 1 at first. Frequencies stay. */
  speed: number;
  /** Plays in step with an animation, a video or audio, wherever it plays, jumps or stops: with the named clip of its
   * name, else with the whole clip. `play`, `speed`, `seek` and `loop` have no effect then. Null at first. */
  follow: AnimationAction | Media | null;
  /** Seconds from the beginning of the clip. */
  readonly position: number;
  /** Begins at the beginning, or with a named clip, which loops if it is meant to. Gain, loop and
   * parameters stay. An unknown name throws a `HapticError`, in silence. */
  play(name?: string): void;
  /** Turns all about the body (degrees to the left, seen from above counterclockwise), raises it by metres, and
   * multiplies heights about the middle of each device; 0, 0, 1: as made. Only devices that go round the body, or are on
   * both sides of it, are turned. */
  place(turnDegrees: number, raiseM?: number, stretch?: number): void;
  /** Stands still with neutral values until it is called with false. */
  pause(isPaused?: boolean): void;
  /** Ends with neutral values, at the beginning of what was played. */
  stop(): void;
  /** Jumps, seconds from the beginning of the clip; what lies between is not felt. */
  seek(seconds: number): void;
  /** Scales a parameter: the deviation of a strength from neutral, a frequency itself. False: the clip
   * has no such parameter. */
  setParameter(parameter: string, factor: number): boolean;
  /** Goes on by seconds times `speed`, or to where what is followed has come; returns `values`. */
  advance(seconds: number): Float32Array;
  silence(): Float32Array;
}

/** An AnimationAction of three.js. */
export interface AnimationAction {
  getClip(): { name: string; duration: number };
  isRunning(): boolean;
  time: number;
  loop: number;
}

/** A video or audio element, or an object with a time of its own, in seconds. */
export interface Media {
  readonly currentTime: number;
  readonly duration: number;
  readonly paused: boolean;
  readonly loop?: boolean;
  readonly ended?: boolean;
  readonly name?: string;
}

/** An object of three.js. Metres; the clip's (x, y, z) is (x, z, -y). */
export interface SceneObject {
  name: string;
  parent: SceneObject | null;
  children: readonly SceneObject[];
  matrixWorld: { elements: ArrayLike<number> };
  isBone?: boolean;
  userData?: { name?: string };
  updateWorldMatrix?(updateParents: boolean, updateChildren: boolean): void;
}

/** A volume that `HapticBody.addVolume` added. */
export class HapticVolume {
  private constructor();
  readonly effect: string;
  object: SceneObject;
  /** 0 (off) to 1 of the effect's own level. */
  level: number;
  /** Numbers for `weights`, `level` and `setParameter` of the body: one for each effect of the name. */
  readonly numbers: readonly number[];
}

/** An avatar that feels volumes and painted areas of a clip on its own moves. */
export class HapticBody implements HapticSource {
  /** `body`: name of a body of the clip; "": its first. `effects`: a clip whose volumes and painted areas are felt, on
   * the body of `clip` and with its devices; those of `clip` if it is left out. An avatar that feels several clips has
   * a body for each. */
  constructor(clip: HapticClip, options?: { body?: string; effects?: HapticClip });
  readonly clip: HapticClip;
  /** The clip of the effects that are felt. */
  readonly effectClip: HapticClip;
  readonly values: Float32Array;
  readonly bones: readonly ClipBone[];
  /** Names of bones that move skin and were not found by `attach`. */
  readonly missing: readonly string[];
  /** Follows the bones below an object, which is in its rest pose now. `space`: the object whose space is
   * the clip's rest space; null: the parent of the topmost bone (the armature). Throws an Error if no bone
   * is found; where some are missing they are named in a warning, and follow their parents. */
  attach(root: SceneObject, options?: { space?: SceneObject | null }): void;
  /** Adds a volume that follows an object. Its shape has unit size, as in Blender: scale the object. */
  addVolume(effect: string, object: SceneObject, level?: number): HapticVolume;
  removeVolume(volume: HapticVolume): void;
  /** Turns a painted area on, at a level of 0 (off) to 1 of its own. */
  trigger(effect: string, level?: number): void;
  /** Turns a painted area about the body's axis (degrees to the left, seen from above counterclockwise), raises it by
   * metres, and multiplies heights about its own middle; 0, 0, 1: as made. Takes as long as some frames. */
  place(effect: string, turnDegrees: number, raiseM?: number, stretch?: number): void;
  /** Takes the pose and the volumes of now, and goes on by seconds; returns `values`. */
  advance(seconds: number): Float32Array;
  silence(): Float32Array;

  /** Without three.js. Matrices are 3 x 4, row after row, in the clip's axes; `number` is the index of an
   * effect in the clip, or a number of an added volume. */
  setBones(matrices: ArrayLike<number>): void;
  setVolume(number: number, matrix: ArrayLike<number>): void;
  triggerEffect(number: number, level: number): void;
  placeEffect(number: number, turnDegrees: number, raiseM: number, stretch: number): void;
  /** Parameter 0 is the strength, in its unit. */
  setParameter(number: number, parameter: number, value: number): void;
  evaluate(seconds: number): Float32Array;
  /** Weights 0 to 1 of the last evaluation at the vertices of an effect's model. */
  weights(number: number): Float32Array;
  /** Level of the last evaluation, the response to the touch included. */
  level(number: number): number;
}

/** A haptic surface of a clip, which vibrates under a finger or a pointer that moves over it. `values`: peak
 * amplitude in m/s² and frequency in Hz. */
export class HapticSurface implements HapticSource {
  /** `name`: "" is the first surface of the clip. `fullMS2`: amplitude at which outputs play full strength, 12.75
   * at first. `side`: which motor or controller plays it. */
  constructor(clip: HapticClip, name?: string, options?: { fullMS2?: number; side?: Side });
  readonly clip: HapticClip;
  readonly surface: Surface;
  readonly values: Float32Array;
  /** Scales all amplitudes; 1 at first. */
  gain: number;
  /** Something touches the surface at shares of the map's width and height from its lower left corner, beyond 0 to
   * 1, too. Speed relative to the material in mm/s; below 0: that of the path. Any number of times each frame. */
  touch(u: number, v: number, speedMmS?: number): void;
  /** Ends the touch, in silence. */
  release(): void;
  /** Follows a pressed pointer on an element, whose area shows the map `repeat` times. Returns a function that
   * ends it. */
  follow(element: HTMLElement, options?: { repeat?: [number, number] }): () => void;
  advance(seconds: number): Float32Array;
  silence(): Float32Array;
}

/** Sends values of sources; each vibration ends by itself after the device's dead-man time. */
export interface HapticOutput {
  /** `nowMs`: time of the frame, milliseconds, as of `requestAnimationFrame`. */
  send(nowMs?: number): void;
}

export interface OutputOptions {
  /** Id of a device in the clip, with or without `_left` or `_right`; "": all devices. */
  device?: string;
}

/** Gamepads: the left side on the strong motor in the left grip, the right side on the weak one in the right
 * grip, all else on both. */
export class GamepadHaptics implements HapticOutput {
  /** `index`: of one gamepad; null: all of them. */
  constructor(sources: HapticSource | HapticSource[], options?: OutputOptions & { index?: number | null });
  send(nowMs?: number): void;
}

/** A phone, by `navigator.vibrate`: a strength is the share of each 20 ms that the motor is on. */
export class PhoneHaptics implements HapticOutput {
  constructor(sources: HapticSource | HapticSource[], options?: OutputOptions);
  /** The browser refused the last pattern, for example before the first touch of the page. */
  readonly isRefused: boolean;
  send(nowMs?: number): void;
}

/** Controllers of a WebXR session, left and right. */
export class XRHaptics implements HapticOutput {
  constructor(session: { inputSources: Iterable<object> }, sources: HapticSource | HapticSource[], options?: OutputOptions);
  send(nowMs?: number): void;
}

/** Advances sources each frame and sends their values. All is silent, and time stands still, while the page is
 * hidden or has lost its focus, or while the headset shows something else. */
export class HapticLoop {
  constructor(sources: HapticSource | HapticSource[], outputs: HapticOutput | HapticOutput[]);
  sources: HapticSource[];
  outputs: HapticOutput[];
  /** Session of WebXR whose visibility counts instead of the page's. */
  session: (EventTarget & { readonly visibilityState: string }) | null;
  readonly isAway: boolean;
  /** Calls `frame` with each frame of the page. A game that draws by itself, or a WebXR session, calls `frame`. */
  start(): void;
  frame(nowMs: number): void;
  /** Ends in silence. */
  stop(): void;
  silence(): void;
}

/** Tells whether a device is one of a name: "" is any, "glove" is glove, glove_left, glove_right. */
export function isDevice(id: string, name: string): boolean;
