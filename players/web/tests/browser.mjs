// SPDX-License-Identifier: MIT
// node tests/browser.mjs CHROMIUM DIST FOLDER [NODE_MODULES]: judges the package in a browser without a window, and
// plays the page of the garage for some seconds. With node_modules of three and iwer also a skeleton of three.js and
// a session of WebXR. Ends with 1 if something is wrong.
import { spawn } from "node:child_process";
import { mkdtempSync, readdirSync, readFileSync, rmSync } from "node:fs";
import { createServer } from "node:http";
import { tmpdir } from "node:os";
import { dirname, join, normalize } from "node:path";
import { fileURLToPath } from "node:url";

const [browser, dist, folder, modules] = process.argv.slice(2);
const here = dirname(fileURLToPath(import.meta.url));
const roots = { "/dist/": dist, "/conformance/": folder, "/tests/": here, ...(modules && { "/modules/": modules }) };
const types = { js: "text/javascript", html: "text/html", json: "application/json" };

function found(url) {
  const path = normalize(url);
  const root = Object.keys(roots).find((start) => path.startsWith(start));
  return root && join(roots[root], path.slice(root.length));
}

const answer = new Promise((resolve, reject) => {
  const server = createServer((request, response) => {
    if (request.method === "POST") {
      let text = "";
      request.on("data", (part) => (text += part));
      request.on("end", () => {
        response.end();
        resolve(JSON.parse(text));
      });
      return;
    }
    try {
      const names = readdirSync(folder).filter((name) => name.endsWith(".txt"));
      const content = request.url === "/names.json" ? JSON.stringify(names) : readFileSync(found(request.url));
      response.setHeader("Content-Type", types[request.url.split(".").pop()] ?? "application/octet-stream");
      response.end(content);
    } catch {
      response.writeHead(404).end();
    }
  });
  server.listen(0, "127.0.0.1", () => {
    const profile = mkdtempSync(join(tmpdir(), "hfx_browser_"));
    const page = `http://127.0.0.1:${server.address().port}/tests/browser.html`;
    const options = ["--headless=new", "--no-sandbox", "--enable-unsafe-swiftshader", "--no-first-run", `--user-data-dir=${profile}`];
    const child = spawn(browser, [...options, page], { stdio: "ignore", detached: true });
    const timer = setTimeout(() => reject(new Error("the browser did not answer within 120 s")), 120_000);
    child.on("error", reject);
    answer.finally(() => {
      clearTimeout(timer);
      try {
        process.kill(-child.pid); // the group that was begun here
      } catch {
        // ended by itself
      }
      server.closeAllConnections();
      server.close();
      rmSync(profile, { recursive: true, force: true, maxRetries: 5 });
    }).catch(() => {});
  });
});

const result = await answer;
console.log([...result.wrong.slice(0, 20), result.summary].join("\n"));
process.exitCode = result.wrong.length ? 1 : 0;
