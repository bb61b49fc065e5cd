// SPDX-License-Identifier: MIT
// node tests/conformance.mjs HFX_JS FOLDER: plays players/conformance; ends with 1 if a value is wrong.
import { readdirSync, readFileSync } from "node:fs";
import { join, resolve } from "node:path";
import { pathToFileURL } from "node:url";
import { judgeClip, judgeWalk } from "./judge.js";

const [script, folder] = process.argv.slice(2);
const hfx = await import(pathToFileURL(resolve(script)));
const results = [];
const names = readdirSync(folder).filter((name) => name.endsWith(".hfxclip"));
for (const name of names) {
  const text = readFileSync(join(folder, name.replace(".hfxclip", ".txt")), "utf8");
  results.push(await judgeClip(hfx, readFileSync(join(folder, name)), text, name));
}
const compared = results.reduce((sum, result) => sum + result.compared, 0);
const walk = readFileSync(join(folder, "spatial", "walk.hfxclip"));
const moves = readFileSync(join(folder, "spatial", "walk.txt"), "utf8");
const walks = [await judgeWalk(hfx, walk, moves, false), await judgeWalk(hfx, walk, moves, true)];
const wrong = [...results, ...walks].flatMap((result) => result.wrong);
wrong.slice(0, 20).forEach((sentence) => console.log(sentence));
console.log(`${names.length} clips, ${compared} values, ${walks.map((result) => result.compared).join(" and ")} weights, ${wrong.length} wrong`);
process.exit(wrong.length || !compared || walks.some((result) => !result.compared) ? 1 : 0);
