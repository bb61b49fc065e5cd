/**
 * Advances players and bodies each frame and sends their values. All is silent, and time stands still, while
 * the page is hidden or has lost its focus, or while the headset is taken off.
 */
export class HapticLoop {
  #lastMs = null;
  #request = null;
  #session = null;
  #leave = () => this.isAway && this.silence();

  constructor(sources, outputs) {
    this.sources = Array.isArray(sources) ? sources : [sources];
    this.outputs = Array.isArray(outputs) ? outputs : [outputs];
    document.addEventListener("visibilitychange", this.#leave);
    window.addEventListener("blur", this.#leave);
    window.addEventListener("pagehide", () => this.silence());
  }

  /** Session of WebXR whose visibility counts instead of the page's; null: none. */
  get session() {
    return this.#session;
  }

  set session(session) {
    this.#session?.removeEventListener("visibilitychange", this.#leave);
    this.#session = session;
    session?.addEventListener("visibilitychange", this.#leave);
    session?.addEventListener("end", () => {
      if (this.#session === session) this.session = null;
    });
    if (!session) this.silence();
  }

  get isAway() {
    if (this.#session) return this.#session.visibilityState !== "visible";
    return document.hidden || !document.hasFocus();
  }

  /** One frame at a time in milliseconds, as of requestAnimationFrame. */
  frame(nowMs) {
    if (this.isAway) {
      this.silence();
      return;
    }
    const seconds = this.#lastMs === null ? 0 : Math.max(nowMs - this.#lastMs, 0) / 1000;
    this.#lastMs = nowMs;
    for (const source of this.sources) source.advance(seconds);
    for (const output of this.outputs) output.send(nowMs);
  }

  /** Calls `frame` with each frame of the page; a game that draws by itself calls it instead. */
  start() {
    this.#request ??= requestAnimationFrame((nowMs) => this.#next(nowMs));
  }

  #next(nowMs) {
    this.#request = null;
    this.start();
    this.frame(nowMs);
  }

  /** Ends in silence. */
  stop() {
    if (this.#request !== null) cancelAnimationFrame(this.#request);
    this.#request = null;
    this.silence();
  }

  silence() {
    this.#lastMs = null;
    for (const source of this.sources) source.silence();
    for (const output of this.outputs) output.send();
  }
}
