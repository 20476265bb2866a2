// Tests the package in Chromium: results are bit-identical to the core.
//
//     node browser.mjs FOLDER-OF-THE-PACKAGE FOLDER-OF-THIS GOLDEN

import assert from "node:assert/strict";
import { existsSync } from "node:fs";
import { createRequire } from "node:module";
import { join } from "node:path";

const folders = process.argv.slice(2);
const require = createRequire(join(process.env.CALIB_NODE_MODULES ?? "", "resolve.js"));
const { chromium } = require("playwright-core");

const ADDRESS = "http://calib.test";
const PAGE = `<!doctype html><title>calib</title><script type="module">
  import * as calib from "/calib.js";
  import { golden } from "/golden.mjs";
  const file = async (name) => (await fetch("/" + name)).arrayBuffer();
  const text = async (name) => new TextDecoder().decode(await file(name));
  try {
    await calib.default();
    globalThis.outcome = golden(calib, { site: await text("site.json"), cameras: await text("cameras.txt"), points: await file("points.f64") });
  } catch (error) {
    globalThis.outcome = "failed: " + error;
  }
</script>`;

const browser = await chromium.launch({ executablePath: process.env.CALIB_CHROMIUM, args: ["--no-sandbox"] });
try {
  const page = await browser.newPage();
  // Requests of the page are answered with files of the folders, without network access.
  await page.route("**/*", (route: { request(): { url(): string }; fulfill(what: object): Promise<void> }) => {
    const name = new URL(route.request().url()).pathname.slice(1);
    const path = folders.map((folder) => join(folder, name)).find((path) => name && existsSync(path));
    if (name && !path) return route.fulfill({ status: 404 });
    return route.fulfill(path ? { path } : { contentType: "text/html", body: PAGE });
  });
  await page.goto(`${ADDRESS}/`);
  const outcome: string = await (await page.waitForFunction("globalThis.outcome", null, { timeout: 60_000 })).jsonValue();
  assert.match(outcome, /bit-identical to the core$/);
  console.log(`Chromium: ${outcome}`);
} finally {
  await browser.close();
}
