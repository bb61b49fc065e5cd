// SPDX-License-Identifier: MIT
// node tests/conformance.mjs HFX_JS FOLDER: plays players/conformance and compares index.d.ts
// with the package; ends with 1 if something is wrong.
import { readdirSync, readFileSync } from "node:fs";
import { join, resolve } from "node:path";
import { pathToFileURL } from "node:url";
import { judgeAll, judgeTypes } from "./judge.js";

const [script, folder] = process.argv.slice(2);
const hfx = await import(pathToFileURL(resolve(script)));
const names = readdirSync(folder).filter((name) => name.endsWith(".txt"));
const result = await judgeAll(hfx, names, async (name) => readFileSync(join(folder, name)));
const declarations = readFileSync(new URL("../index.d.ts", import.meta.url), "utf8");
const types = await judgeTypes(hfx, declarations, readFileSync(join(folder, "spatial", "walk.hfxclip")), readFileSync(join(folder, "surfaces", "strokes.hfxclip")));
result.wrong.push(...types.wrong, ...(types.compared > 60 ? [] : [`${types.compared} members only`]));
console.log([...result.wrong.slice(0, 20), result.summary].join("\n"));
process.exit(result.wrong.length ? 1 : 0);
