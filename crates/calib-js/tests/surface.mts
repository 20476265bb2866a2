// Tests the properties of cameras and sites, undistortion of images, and calibration with options.

import assert from "node:assert/strict";
import type * as Calib from "../../../target/js/calib.js";

type Rows = number[][];

const product = (a: Rows, b: Rows): Rows => a.map((row) => b[0].map((_, k) => row.reduce((sum, value, i) => sum + value * b[i][k], 0)));

function near(found: number[], expected: number[], within: number): void {
  assert.equal(found.length, expected.length);
  found.forEach((value, i) => assert.ok(Math.abs(value - expected[i]) <= within, `${found} for ${expected}`));
}

/** Tests the demonstration site as solved by the command line. */
export function surface(calib: typeof Calib, native: string, drawn: string): void {
  const site = new calib.Site(native);
  const document = JSON.parse(native);
  for (const entry of document.cameras) {
    const { solution } = entry;
    const camera = site.camera(entry.id);
    assert.equal(camera.id, entry.id);
    assert.deepEqual(camera.size, entry.size_px);
    assert.deepEqual([camera.origin, camera.streamSize, camera.fit, camera.crop], ["corner", undefined, undefined, undefined]);
    near(camera.position, solution.position_m, 1e-12);
    near([camera.yawDeg, camera.pitchDeg, camera.rollDeg], [solution.yaw_deg, solution.pitch_deg, solution.roll_deg], 1e-9);
    near([camera.focalPx, ...camera.principalPointPx], [solution.focal_px, ...solution.principal_point_px], 1e-9);
    if (solution.distortion) assert.equal(camera.distortion?.model, solution.distortion.model);
    else assert.equal(camera.distortion, undefined);
    assert.equal(camera.covariance.length, 15);
    matrices(camera);
    stream(camera);
    image(camera);
    camera.free();
  }
  findings(calib, site, document, new calib.Site(drawn));
  plan(site, document);
}

/** Matrices and methods of a camera map points to the same results. */
function matrices(camera: Calib.Camera): void {
  const [x, y, z] = [camera.efov[0], camera.efov[1], 0];
  const [[u], [v], [w]] = product(camera.projectionMatrix, [[x], [y], [z], [1]]);
  const [[fx], [fy], [fw]] = product(camera.floorFromPixel, [[u / w], [v / w], [1]]);
  near([fx / fw, fy / fw], [x, y], 1e-6);
  const raw = camera.toPixel(Float64Array.of(x), Float64Array.of(y));
  assert.deepEqual(raw, camera.toPixel(Float64Array.of(x), Float64Array.of(y), Float64Array.of(0)));
  const straight = camera.undistort(raw.u, raw.v);
  if (!Number.isNaN(straight.u[0])) near([straight.u[0], straight.v[0]], [u / w, v / w], 1e-6);
  // J C J^T is the calibration's part of the covariance.
  const [a, b] = [Float64Array.of(camera.size[0] / 2), Float64Array.of(0.9 * camera.size[1])];
  const jacobian = camera.floorJacobian(a, b);
  assert.equal(jacobian.length, 30);
  const rows = [Array.from(jacobian.subarray(0, 15)), Array.from(jacobian.subarray(15))];
  const transposed = rows[0].map((_, k) => rows.map((row) => row[k]));
  const both = product(product(rows, camera.covariance), transposed);
  const { calibration } = camera.floorCovariance(a, b);
  if (camera.covariance.flat().every(Number.isFinite)) near(both.flat().map((value, i) => value / calibration[i]), [1, 1, 1, 1], 1e-6);
  else assert.ok(calibration.every(Number.isNaN), "a camera placed by hand has no uncertainty");
  assert.equal(camera.scaleKnown, true);
  const box = Float64Array.of(a[0] - 20, b[0] - 300, a[0] + 20, b[0]);
  assert.deepEqual(camera.boxesCovariance(box, "xyxy", 1.5), camera.floorCovariance(a, b, 1.5));
  assert.throws(() => camera.boxesCovariance(box.subarray(1), "xyxy"), /four numbers/);
}

/** A camera of another stream gives the same points. */
function stream(camera: Calib.Camera): void {
  const half = camera.withStream({ streamSize: [camera.size[0] / 2, camera.size[1] / 2], origin: "centre" });
  assert.deepEqual([half.origin, half.streamSize], ["centre", [camera.size[0] / 2, camera.size[1] / 2]]);
  near([half.focalPx, half.cameraMatrix[0][2]], [camera.focalPx / 2, camera.principalPointPx[0] / 2 - 0.5], 1e-9);
  const [still, small] = [camera.toFloor(Float64Array.of(800), Float64Array.of(900)), half.toFloor(Float64Array.of(399.5), Float64Array.of(449.5))];
  near([...small.x, ...small.y], [...still.x, ...still.y], 1e-9);
  const stretched = camera.withStream({ streamSize: [300, 290], fit: "stretch" });
  assert.equal(stretched.fit, "stretch");
  assert.throws(() => stretched.focalPx, /stretched/);
  assert.throws(() => stretched.undistorter(), /stretched/);
  assert.throws(() => camera.withStream({ at: "now" } as Calib.StreamOptions), /origin, streamSize/);
  assert.throws(() => camera.withStream({ streamSize: [100, 130] }), new RegExp(camera.id));
  assert.throws(() => camera.withStream({ streamSize: ["x", 640, 480] as unknown as [number, number] }), /whole pixels/);
}

/** The undistorted image has the colour of each raw pixel at its undistorted position. */
function image(camera: Calib.Camera): void {
  const [width, height] = camera.size.map((side) => side / 10);
  const small = camera.withStream({ streamSize: [width, height] });
  const undistorter = small.undistorter("same-focal");
  assert.deepEqual(undistorter.size, [width, height]);
  near([undistorter.focal, ...undistorter.principalPoint], [small.focalPx, ...small.principalPointPx], 1e-9);
  const at = (u: number, v: number): number => 4 * (Math.floor(u) + width * Math.floor(v));
  const ramp = new Uint8ClampedArray(4 * width * height);
  for (let v = 0; v < height; v += 1) for (let u = 0; u < width; u += 1) ramp.set([u, v, 7, 255], at(u, v));
  const straight = undistorter.apply(ramp);
  const [u, v] = [Float64Array.of(60.5, width - 60.5), Float64Array.of(40.5, height - 28.5)];
  const to = small.undistort(u, v);
  for (const k of [0, 1]) {
    const pixel = at(to.u[k], to.v[k]);
    // Tolerance for the neighbouring pixel, and for the rounding of colours.
    near([straight[pixel], straight[pixel + 1]], [u[k] - 0.5, v[k] - 0.5], 2);
  }
  assert.throws(() => undistorter.apply(ramp.subarray(1)), new RegExp(`${width} x ${height}`));
  assert.throws(() => small.undistorter("valid" as "all-valid"), /all-valid/);
  undistorter.free();
}

/** Findings equal the command line's, and the calibration respects its options. */
function findings(calib: typeof Calib, site: Calib.Site, document: { cameras: { id: string; solution: { warnings: { code: string; message: string }[] } }[]; solution?: { warnings?: { code: string }[] } }, drawn: Calib.Site): void {
  const expected = document.cameras.flatMap(({ id, solution }) => (solution.warnings ?? []).map(({ code, message }) => [id, code, message]));
  const found: Calib.Finding[] = site.findings;
  assert.deepEqual(found.filter(({ camera }) => camera).map(({ camera, code, message }) => [camera, code, message]), expected);
  assert.equal(found.length, expected.length + (document.solution?.warnings ?? []).length);
  const first = drawn.calibrate({ cameras: [document.cameras[0].id], refine: false });
  assert.deepEqual(first.cameras, [document.cameras[0].id]);
  assert.ok(first.toJson().length > drawn.toJson().length);
  assert.throws(() => drawn.calibrate({ cameras: ["nobody"] }), /"nobody"/);
  assert.throws(() => drawn.calibrate({ method: "best" as "ml" }), /"paper"/);
  assert.throws(() => calib.solve(drawn.toJson(), { refin: true } as Calib.CalibrateOptions), /refine/);
}

/** Conversions between plan and floor are inverse, and use the scale of the file. */
function plan(site: Calib.Site, document: { plan?: { metres_per_px: number } }): void {
  assert.ok(document.plan, "the demonstration has a plan");
  const pixels = site.floorToPlan(Float64Array.of(0, 0, 3, 4));
  near([Math.hypot(pixels[2] - pixels[0], pixels[3] - pixels[1])], [5 / document.plan.metres_per_px], 1e-6);
  near([...site.planToFloor(pixels)], [0, 0, 3, 4], 1e-9);
  assert.equal(site.planMetresPerPx, document.plan.metres_per_px);
  assert.throws(() => site.floorToPlan(Float64Array.of(1)), /even/);
}
