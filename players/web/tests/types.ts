// SPDX-License-Identifier: MIT
// Compiled only: npx -p typescript -p @types/three tsc --noEmit --strict ... tests/types.ts
import * as THREE from "three";
import { GamepadHaptics, HapticBody, HapticClip, HapticLoop, HapticPlayer, PhoneHaptics, XRHaptics } from "../index.js";

export async function library(avatar: THREE.Object3D, action: THREE.AnimationAction, film: HTMLVideoElement) {
  const clip = await HapticClip.load("avatar.hfxclip");
  const effects = await HapticClip.load("library.hfxclip");
  const bodies = [new HapticBody(clip, { effects }), new HapticBody(clip)];
  for (const body of bodies) body.attach(avatar);
  bodies[0].place("Hit", 90, 0.1);
  const player = new HapticPlayer(clip);
  player.place(180);
  player.speed = 0.5;
  player.follow = action;
  player.follow = film;
  return bodies[0].effectClip.effects.map((effect) => effect.name);
}

export async function garage(avatar: THREE.Object3D, fire: THREE.Mesh, renderer: THREE.WebGLRenderer) {
  const clip = await HapticClip.load(new URL("garage.hfxclip", "https://example.org/"));
  const player = new HapticPlayer(clip);
  const body = new HapticBody(clip, { body: "Avatar" });
  body.attach(avatar, { space: avatar.children[0] });
  const volume = body.addVolume("Fire", fire, 0.5);
  volume.level = 1;
  body.trigger("Engine");
  const loop = new HapticLoop([player, body], [new GamepadHaptics([player, body], { index: 0 }), new PhoneHaptics(player)]);
  const session = renderer.xr.getSession();
  if (session) {
    loop.session = session;
    loop.outputs.push(new XRHaptics(session, body, { device: "oculus_touch" }));
  }
  player.onfinished = () => player.play("Strike");
  player.loop = clip.namedClips.some((named) => named.loops);
  renderer.setAnimationLoop((time) => loop.frame(time));
  body.removeVolume(volume);
  return player.setParameter("frequency_hz", 1.2) && player.values[0] > 0 ? body.missing.join() : undefined;
}
