import { unknownName } from "./clip.js";

const LONGEST_STEP_S = 0.5; // of something that is followed
const REPEAT = 2201; // three.js' LoopRepeat

/**
 * What is followed, now: an AnimationAction of three.js, a video or audio element, or any object with `currentTime`,
 * `duration`, `loop`, `paused` and maybe `name`.
 */
function clockOf(item) {
  if (item.getClip) {
    const { name, duration } = item.getClip();
    return { name, seconds: item.time, duration, loops: item.loop === REPEAT, isRunning: item.isRunning() };
  }
  const { name = "", currentTime, duration, loop, paused, ended } = item;
  return { name, seconds: currentTime, duration, loops: Boolean(loop), isRunning: !paused && !ended };
}

/** Plays a clip: each frame, of each actuator, the strongest row since the last frame. */
export class HapticPlayer {
  #at;
  #out;
  #gain = 1;
  #loop = false;
  #follow = null;
  #part = null; // what is played of it: name, start, length in seconds

  constructor(clip) {
    const { core } = clip;
    this.clip = clip;
    this.values = clip.neutralValues();
    this.onfinished = null;
    this.isPaused = false;
    this.speed = 1;
    this.#at = core.take(core.calls.hfx_player_size(), this);
    this.#out = core.take(4 * this.values.length || 4, this);
    core.calls.hfx_player_play(this.#at, clip.address);
    core.calls.hfx_player_stop(this.#at);
  }

  /** Begins at the beginning, or with a named clip, which loops if it is meant to. */
  play(name = "") {
    const { core, namedClips } = this.clip;
    this.isPaused = false;
    const error = core.calls.hfx_player_replay(this.#at, core.text(name));
    if (!error) return;
    this.silence();
    throw unknownName("named clip", name, namedClips.map((item) => item.name));
  }

  /** Scales how far all strengths are from neutral. */
  get gain() {
    return this.#gain;
  }

  set gain(gain) {
    this.#gain = gain;
    this.clip.core.calls.hfx_player_gain(this.#at, gain);
  }

  /** Whether the whole clip, and what plays now, begins again at its end. */
  get loop() {
    return this.#loop;
  }

  set loop(loop) {
    this.#loop = loop;
    this.clip.core.calls.hfx_player_loop(this.#at, loop ? 1 : 0);
  }

  /**
   * Turns all about the body (degrees to the left, seen from above counterclockwise), raises it by metres, and
   * multiplies heights about the middle of each device; 0, 0, 1: as made.
   */
  place(turnDegrees, raiseM = 0, stretch = 1) {
    this.clip.core.calls.hfx_player_place(this.#at, turnDegrees, raiseM, stretch);
  }

  /** What is followed, in place of `play`, `speed`, `seek` and `loop`; null: nothing. */
  get follow() {
    return this.#follow;
  }

  set follow(item) {
    this.stop();
    this.#follow = item;
    this.#part = null;
    this.loop = this.#loop;
  }

  /** Stands still with neutral values until it is called with false. */
  pause(isPaused = true) {
    this.isPaused = isPaused;
    this.clip.core.calls.hfx_player_pause(this.#at, isPaused ? 1 : 0);
    if (isPaused) this.silence();
  }

  /** Ends with neutral values. */
  stop() {
    this.clip.core.calls.hfx_player_stop(this.#at);
    this.silence();
  }

  /** Jumps, seconds from the beginning of the clip; what lies between is not felt. */
  seek(seconds) {
    this.clip.core.calls.hfx_player_seek(this.#at, seconds);
  }

  /** Scales a parameter, say `amplitude_m_s2`; false: no column of the clip has it. */
  setParameter(parameter, factor) {
    const { core } = this.clip;
    return core.calls.hfx_player_set_parameter(this.#at, core.text(parameter), factor) === 0;
  }

  get isPlaying() {
    return this.clip.core.calls.hfx_player_is_playing(this.#at) !== 0;
  }

  /** Seconds from the beginning of the clip. */
  get position() {
    return this.clip.core.calls.hfx_player_position(this.#at);
  }

  /** Goes on by seconds times `speed`, or to where what is followed has come; returns `values`. */
  advance(seconds) {
    return this.#follow ? this.#advanceTo(clockOf(this.#follow)) : this.#advanceBy(seconds * this.speed);
  }

  #advanceTo(clock) {
    const { calls } = this.clip.core;
    if (!clock.isRunning) {
      if (this.#part) this.stop();
      this.#part = null;
      return this.silence();
    }
    if (this.#part?.name !== clock.name) this.#begin(clock);
    const { start, length } = this.#part;
    const loops = clock.loops && Math.abs(clock.duration - length) < 0.001 * length; // else it ends before or with it
    let passed = start + clock.seconds - this.position;
    calls.hfx_player_loop(this.#at, loops ? 1 : 0);
    if (loops && passed < 0) passed += length; // it has begun again
    if (!this.isPlaying) {
      if (passed >= 0) return this.silence(); // it is over before what is followed is
      this.#begin(clock);
      passed = 0;
    }
    if (passed < 0 || passed > LONGEST_STEP_S) {
      this.seek(start + clock.seconds); // it has jumped
      passed = 0;
    }
    return this.#advanceBy(passed);
  }

  /** Begins with the named clip of what is followed, else with the whole clip, at its time. */
  #begin({ name, seconds }) {
    const named = this.clip.namedClips.find((item) => item.name === name);
    const isPaused = this.isPaused;
    this.play(named ? name : "");
    this.pause(isPaused);
    this.#part = { name, start: named?.startS ?? 0, length: named ? named.endS - named.startS : this.clip.seconds };
    this.seek(this.#part.start + seconds);
  }

  #advanceBy(seconds) {
    const { core } = this.clip;
    const wasPlaying = this.isPlaying;
    core.calls.hfx_player_advance(this.#at, seconds, this.#out);
    this.values.set(core.floats(this.#out, this.values.length));
    if (wasPlaying && !this.isPlaying) this.onfinished?.();
    return this.values;
  }

  /** Makes all values neutral until the next `advance`; time does not go on. */
  silence() {
    for (let k = 0; k < this.values.length; k++) this.values[k] = this.clip.columns[k].neutral;
    return this.values;
  }
}
