// Compares the package with the command line: same solutions, same points, and helpful errors.
//
//     node package.mjs FOLDER-OF-THE-PACKAGE CALIB GOLDEN
//
// The compiler checks its types.

import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { mkdtempSync, readFileSync, rmSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { pathToFileURL } from "node:url";
import { golden } from "./golden.mjs";
import { surface } from "./surface.mjs";
import type * as Calib from "../../../target/js/calib.js";

const [folder, program, points] = process.argv.slice(2);
const calibJs = (await import(pathToFileURL(join(folder, "calib.js")).href)) as typeof Calib;
const { initSync, Site, solve } = calibJs;
initSync({ module: readFileSync(join(folder, "calib_bg.wasm")) });

const scratch = mkdtempSync(join(tmpdir(), "calib-js-"));
const calib = (args: string[], input?: string): string =>
  execFileSync(program, args, { cwd: scratch, input, encoding: "utf8", stdio: ["pipe", "pipe", "ignore"] });

/** Returns the largest relative difference between the numbers of two documents with the same keys. */
function difference(a: unknown, b: unknown, place = ""): number {
  if (typeof a === "number" && typeof b === "number") return Math.abs(a - b) / (1 + Math.abs(b));
  if (typeof a === "object" && typeof b === "object" && a && b) {
    assert.deepEqual(Object.keys(a), Object.keys(b), place);
    const [left, right] = [Object.entries(a), Object.values(b)];
    return Math.max(0, ...left.map(([key, value], i) => difference(value, right[i], `${place}/${key}`)));
  }
  assert.equal(a, b, place);
  return 0;
}

try {
  calib(["demo"]);
  const drawn = readFileSync(join(scratch, "calib-demo/site.json"), "utf8");
  calib(["solve", "calib-demo/site.json", "-o", "calib-demo/native.json"]);
  const native: string = readFileSync(join(scratch, "calib-demo/native.json"), "utf8");

  const solved: string = solve(drawn);
  // Sines and cosines differ in the last bit, and residuals are small differences of pixels.
  const [here, there] = [JSON.parse(solved), JSON.parse(native)];
  assert.ok(difference(here, there) < 1e-7, "the solutions differ");
  // Roll and yaw are interchangeable for a camera that looks straight down, so the tolerance includes their sigma.
  for (const [index, { id, solution }] of there.cameras.entries()) {
    const [own, { sigma }] = [here.cameras[index].solution, solution];
    const numbers = (of: Record<string, any>): Record<string, number> => {
      const [x_m, y_m, z_m]: number[] = of.position_m;
      const { yaw_deg, pitch_deg, roll_deg, focal_px } = of;
      return { x_m, y_m, z_m, yaw_deg, pitch_deg, roll_deg, focal_px };
    };
    const [mine, its] = [numbers(own), numbers(solution)];
    for (const [key, value] of Object.entries(its)) {
      const [apart, most] = [Math.abs(mine[key]! - value), 1e-9 * (1 + Math.abs(value)) + 1e-7 * (sigma[key] ?? 0)];
      assert.ok(apart < most, `${key} of ${id} differs by ${apart}`);
    }
    assert.ok(difference(own.sigma, sigma) < 1e-7, `sigmas of ${id} differ`);
  }

  const site = new Site(native);
  const cameras: string[] = site.cameras;
  assert.deepEqual(cameras, JSON.parse(native).cameras.map((camera: { id: string }) => camera.id));
  let mapped = 0;
  for (const [index, id] of cameras.entries()) {
    // A camera placed by hand has no uncertainty.
    const isKnown = there.cameras[index].solution.sigma.x_m !== undefined;
    const pixels = Array.from({ length: 40 }, (_, i) => [(i % 8) * 230 + 3, Math.floor(i / 8) * 240 - 100]);
    const csv = pixels.map(([u, v]) => `${u},${v}\n`).join("");
    const rows = calib(["project", "calib-demo/native.json", "--camera", id, "--to", "floor"], `u,v\n${csv}`);
    const many: Float64Array = site.pixelsToFloor(id, Float64Array.from(pixels.flat()));
    for (const [i, line] of rows.trim().split("\n").slice(1).entries()) {
      const [u, v, x, y, status] = line.split(",");
      const point: Calib.FloorPoint | undefined = site.pixelToFloor(id, Number(u), Number(v), 2);
      if (x === "") {
        assert.equal(point, undefined, line);
        assert.ok(Number.isNaN(many[2 * i]), line);
        continue;
      }
      assert.ok(point, line);
      assert.equal(point.status, status);
      assert.ok(difference([point.x, point.y], [Number(x), Number(y)]) < 1e-9, line);
      assert.ok(difference([many[2 * i], many[2 * i + 1]], [point.x, point.y]) < 1e-12, line);
      assert.equal((point.sigma ?? 0) > 0, isKnown, line);
      const back: Calib.Pixel | undefined = site.floorToPixel(id, point.x, point.y);
      assert.ok(back && Math.hypot(back.u - Number(u), back.v - Number(v)) < 1e-6, line);
      mapped += 1;
    }
  }
  assert.ok(mapped > 20 * cameras.length, `${mapped} pixels show the floor`);
  assert.ok(site.floorToPixel(cameras[0], 1, 2, 1.7));
  surface(calibJs, native, drawn);

  // A platform and a pit next to each other, in view of the first camera.
  const middle = site.pixelToFloor(cameras[0], 960, 800);
  assert.ok(middle && middle.z === undefined, "points have no height without planes");
  const square = (x: number, y: number) => [[x, y - 1], [x + 1, y - 1], [x + 1, y + 1], [x, y + 1]];
  const uneven = JSON.parse(native);
  uneven.planes = [
    { id: "platform", height_m: 0.3, region: square(middle.x - 1, middle.y) },
    { id: "pit", height_m: -0.3, region: square(middle.x, middle.y) },
  ];
  writeFileSync(join(scratch, "uneven.json"), JSON.stringify(uneven));
  const planes = new Site(JSON.stringify(uneven));
  const fine = Array.from({ length: 1200 }, (_, i) => [(i % 40) * 48, Math.floor(i / 40) * 36]);
  const table = calib(["project", "uneven.json", "--camera", cameras[0], "--to", "floor"],
    `u,v\n${fine.map(([u, v]) => `${u},${v}\n`).join("")}`);
  const shown = new Set<string>();
  for (const line of table.trim().split("\n").slice(1)) {
    const [u, v, x, y, status, z, plane] = line.split(",");
    const point: Calib.FloorPoint | undefined = planes.pixelToFloor(cameras[0], Number(u), Number(v));
    assert.equal(point === undefined, x === "", line);
    shown.add(point ? plane : status);
    if (!point) continue;
    assert.equal(point.plane ?? "", plane, line);
    assert.ok(difference([point.x, point.y, point.z], [Number(x), Number(y), Number(z)]) < 1e-9, line);
  }
  for (const what of ["", "platform", "pit", "on-wall"]) assert.ok(shown.has(what), `no pixel shows ${what}`);

  const moved = JSON.parse(native);
  moved.cameras = [moved.cameras[0], structuredClone(moved.cameras[0])];
  moved.links = moved.marks = moved.distances = [];
  [moved.cameras[0].valid_to, moved.cameras[1].valid_from] = ["2026-06-01T00:00:00Z", "2026-06-01T00:00:00Z"];
  const periods = new Site(JSON.stringify(moved));
  assert.throws(() => periods.pixelToFloor(cameras[0], 900, 900), /several periods/);
  assert.throws(() => periods.floorToPixel(cameras[0], 1, 2, 0, "noon"), /time/);
  assert.ok(periods.floorToPixel(cameras[0], 1, 2, 0, { at: "2026-05-01T00:00:00Z" }));
  assert.deepEqual(periods.cameras, [cameras[0]]);
  assert.ok(periods.pixelToFloor(cameras[0], 900, 900, 1, "2026-05-01T00:00:00Z"));
  assert.equal(periods.pixelsToFloor(cameras[0], Float64Array.of(900, 900), "2026-07-01T00:00:00Z").length, 2);

  assert.throws(() => new Site('{"format": "calib-site", "version": 2}'), /version/);
  assert.throws(() => solve("{"), Error);
  assert.throws(() => site.pixelToFloor("nobody", 1, 2), /"nobody": the site has no camera/);
  assert.throws(() => new Site(drawn).pixelToFloor(cameras[0], 1, 2), /not calibrated/);
  assert.equal(site.floorToPixel(cameras[0], Number.NaN, 0), undefined);
  assert.equal(site.pixelToFloor(cameras[0], Number.NaN, 0), undefined);
  site.free();
  const file = (name: string): Buffer => readFileSync(join(points, name));
  const bytes = new Uint8Array(file("points.f64"));
  console.log(golden(calibJs, { site: file("site.json").toString(), cameras: file("cameras.txt").toString(), points: bytes.buffer }));
  console.log(`${mapped} pixels of ${cameras.length} cameras equal to the command line`);
} finally {
  rmSync(scratch, { recursive: true });
}
