import { unknownName } from "./clip.js";

/** Plays a clip: each frame, of each actuator, the strongest row since the last frame. */
export class HapticPlayer {
  #at;
  #out;
  #namedLoops = false;
  #factors = new Map();

  constructor(clip) {
    const core = clip.core;
    this.clip = clip;
    this.values = clip.neutralValues();
    this.gain = 1;
    this.loop = false;
    this.onfinished = null;
    this.isPaused = false;
    this.#at = core.take(core.calls.hfx_player_size(), this);
    this.#out = core.take(4 * this.values.length || 4, this);
    core.calls.hfx_player_play(this.#at, clip.address); // a player of zeros knows no neutral values
    core.calls.hfx_player_stop(this.#at);
  }

  /** Begins at the beginning, or with a named clip, which loops if it is meant to. */
  play(name = "") {
    const { calls } = this.clip.core;
    const named = this.clip.namedClips.find((known) => known.name === name);
    if (name && !named) {
      const known = this.clip.namedClips.map((item) => item.name);
      throw unknownName("named clip", name, known);
    }
    if (named) calls.hfx_player_play_named(this.#at, this.clip.address, this.clip.core.text(name));
    else calls.hfx_player_play(this.#at, this.clip.address);
    this.#namedLoops = named?.loops ?? false;
    this.isPaused = false;
    for (const [parameter, factor] of this.#factors) this.setParameter(parameter, factor);
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
    const error = core.calls.hfx_player_set_parameter(this.#at, core.text(parameter), factor);
    if (!error) this.#factors.set(parameter, factor);
    return !error;
  }

  get isPlaying() {
    return this.clip.core.calls.hfx_player_is_playing(this.#at) !== 0;
  }

  /** Seconds from the beginning of the clip. */
  get position() {
    return this.clip.core.calls.hfx_player_position(this.#at);
  }

  /** Goes on by seconds; returns `values`. */
  advance(seconds) {
    const { core } = this.clip;
    const wasPlaying = this.isPlaying;
    core.calls.hfx_player_gain(this.#at, this.gain);
    core.calls.hfx_player_loop(this.#at, this.loop || this.#namedLoops ? 1 : 0);
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
