import { unknownName } from "./clip.js";

/** Plays a clip: each frame, of each actuator, the strongest row since the last frame. */
export class HapticPlayer {
  #at;
  #out;
  #gain = 1;
  #loop = false;

  constructor(clip) {
    const { core } = clip;
    this.clip = clip;
    this.values = clip.neutralValues();
    this.onfinished = null;
    this.isPaused = false;
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

  /** Goes on by seconds; returns `values`. */
  advance(seconds) {
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
