// The world from above on a canvas: metres with y up, on any screen.
const colours = names => {
  const style = getComputedStyle(document.documentElement);
  return Object.fromEntries(names.map(name => [name, style.getPropertyValue(`--${name}`).trim()]));
};
const NAMES = ["wall", "thing", "goal", "scan", "cone", "chair", "person", "door", "trail", "track", "asked", "given", "text", "alarm", "accent", "veil"];

export class View {
  constructor(canvas) {
    this.canvas = canvas;
    this.context = canvas.getContext("2d");
    this.bounds = [0, 0, 10, 10];
    this.zoom = 1;
    this.centre = null; // of the picture [m]; null: the middle of the world
    this.watch = new ResizeObserver(() => { this.fit(); this.onresize?.(); });
    this.watch.observe(canvas);
    this.restyle();
  }

  close() { this.watch.disconnect(); }

  restyle() { this.colour = colours(NAMES); }

  fit() {
    const ratio = devicePixelRatio || 1;
    this.canvas.width = Math.max(1, Math.round(this.canvas.clientWidth * ratio));
    this.canvas.height = Math.max(1, Math.round(this.canvas.clientHeight * ratio));
    const [x0, y0, x1, y1] = this.bounds;
    const whole = Math.min(this.canvas.width / (x1 - x0 + 0.6), this.canvas.height / (y1 - y0 + 0.6));
    this.scale = whole * this.zoom;
    this.pixel = ratio / this.scale;
  }

  middle() {
    const [x0, y0, x1, y1] = this.bounds;
    return this.zoom > 1 && this.centre ? this.centre : [(x0 + x1) / 2, (y0 + y1) / 2];
  }

  /** The place [m] of a pointer's event. */
  place(event) {
    const box = this.canvas.getBoundingClientRect(), ratio = this.canvas.width / box.width, [x, y] = this.middle();
    return [x + ((event.clientX - box.left) * ratio - this.canvas.width / 2) / this.scale,
      y - ((event.clientY - box.top) * ratio - this.canvas.height / 2) / this.scale];
  }

  /** Clear, and draw from now on in metres. */
  begin() {
    this.fit();
    const c = this.context, [x, y] = this.middle();
    c.setTransform(1, 0, 0, 1, 0, 0);
    c.clearRect(0, 0, this.canvas.width, this.canvas.height);
    c.setTransform(this.scale, 0, 0, -this.scale, this.canvas.width / 2 - x * this.scale, this.canvas.height / 2 + y * this.scale);
    c.lineJoin = c.lineCap = "round";
  }

  segments(rows, colour, width = 2) {
    const c = this.context;
    c.beginPath();
    for (const [x0, y0, x1, y1] of rows) { c.moveTo(x0, y0); c.lineTo(x1, y1); }
    c.strokeStyle = colour; c.lineWidth = width * this.pixel; c.stroke();
  }

  line(points, colour, width = 2, dash = []) {
    if (points.length < 2) return;
    const c = this.context;
    c.beginPath();
    points.forEach(([x, y], k) => (k ? c.lineTo(x, y) : c.moveTo(x, y)));
    c.setLineDash(dash.map(one => one * this.pixel));
    c.strokeStyle = colour; c.lineWidth = width * this.pixel; c.stroke(); c.setLineDash([]);
  }

  disc(x, y, radius, colour, filled = true, width = 2) {
    const c = this.context;
    c.beginPath(); c.arc(x, y, radius, 0, 2 * Math.PI);
    if (filled) { c.fillStyle = colour; c.fill(); } else { c.strokeStyle = colour; c.lineWidth = width * this.pixel; c.stroke(); }
  }

  polygon(points, colour, filled = true, width = 2) {
    const c = this.context;
    c.beginPath(); points.forEach(([x, y], k) => (k ? c.lineTo(x, y) : c.moveTo(x, y))); c.closePath();
    if (filled) { c.fillStyle = colour; c.fill(); } else { c.strokeStyle = colour; c.lineWidth = width * this.pixel; c.stroke(); }
  }

  dots(points, colour, size = 3) {
    const c = this.context, side = size * this.pixel;
    c.fillStyle = colour;
    for (const [x, y] of points) c.fillRect(x - side / 2, y - side / 2, side, side);
  }

  arrow(x, y, dx, dy, colour, width = 3) {
    const size = Math.hypot(dx, dy);
    if (size < 0.02) return;
    const c = this.context, ux = dx / size, uy = dy / size, tip = Math.min(0.18, size * 0.6);
    c.beginPath(); c.moveTo(x, y); c.lineTo(x + dx, y + dy);
    c.moveTo(x + dx - tip * (ux - 0.6 * uy), y + dy - tip * (uy + 0.6 * ux));
    c.lineTo(x + dx, y + dy); c.lineTo(x + dx - tip * (ux + 0.6 * uy), y + dy - tip * (uy - 0.6 * ux));
    c.strokeStyle = colour; c.lineWidth = width * this.pixel; c.stroke();
  }
}

/** A point of the chair's frame, or of anything's, on the map. */
export const placed = ([x, y, yaw], [ahead, left]) =>
  [x + ahead * Math.cos(yaw) - left * Math.sin(yaw), y + ahead * Math.sin(yaw) + left * Math.cos(yaw)];

/** Walls, round things, and the goal. */
export function drawWorld(view, world) {
  for (const [x, y, r] of world.discs) view.disc(x, y, r, view.colour.thing);
  view.segments(world.walls, view.colour.wall, 2.5);
  drawGoal(view, world);
}

export function drawGoal(view, world) {
  const [x, y] = world.goal;
  view.disc(x, y, Math.max(world.tolerance, 0.1), view.colour.goal, false, 3);
  view.disc(x, y, 0.08, view.colour.goal);
}

/** Who moves: people and round things as discs, doors and furniture as boxes. */
export function drawActors(view, kinds, poses) {
  poses.forEach((pose, k) => {
    if (pose[0] === null || !kinds[k]) return;
    const [kind, length, width] = kinds[k], colour = kind === "person" ? view.colour.person : kind === "door" ? view.colour.door : view.colour.thing;
    if (width === 0) {
      view.disc(pose[0], pose[1], length, colour, false, 2.5);
      return;
    }
    const front = kind === "door" ? length : length / 2, rear = front - length, half = width / 2;
    view.polygon([[rear, -half], [front, -half], [front, half], [rear, half]].map(one => placed(pose, one)), colour);
  });
}

/** The chair's outline with its heading, and what was asked and given as arrows. */
export function drawChair(view, world, now) {
  view.polygon(world.outline.map(one => placed(now.pose, one)), now.contact ? view.colour.alarm : view.colour.chair, false, 3);
  view.line([placed(now.pose, [0, 0]), placed(now.pose, [0.45, 0])], view.colour.chair, 3);
  const [forward, , turn] = world.limits, arrow = ([v, w]) => [1.2 * v / forward, 0.8 * w / turn];
  for (const [twist, colour] of [[[now.stick[0] * forward, now.stick[1] * turn], view.colour.asked], [now.given, view.colour.given]]) {
    const [x, y] = now.pose, [tx, ty] = placed([0, 0, now.pose[2]], arrow(twist));
    view.arrow(x, y, tx, ty, colour);
  }
}

const SECTORS = 64; // of the scan, each of which is noticed or not
const FAR = 1000; // m

/** Cover what a person does not see: beyond an angle to either side, and sectors beyond the angle of neglect. */
export function drawVeil(view, world, now) {
  if (!now.sight) return;
  const [left, right, neglect, unnoticed] = now.sight, c = view.context, [mx, my, turn, fov] = world.laser, first = turn - fov / 2;
  const wedge = ([x, y], from, to) => {
    if (to <= from) return;
    c.moveTo(x, y); c.arc(x, y, FAR, now.pose[2] + from, now.pose[2] + to); c.closePath();
  };
  c.save();
  c.fillStyle = view.colour.veil;
  c.beginPath(); wedge(now.pose, left, Math.PI); wedge(now.pose, -Math.PI, -right); c.fill();
  c.beginPath(); wedge(now.pose, neglect, Math.PI); c.clip();
  const mount = placed(now.pose, [mx, my]), each = fov / SECTORS;
  c.beginPath();
  for (const k of unnoticed) wedge(mount, first + k * each, first + (k + 1) * each + 0.002); // without a seam between two
  wedge(mount, first + fov, first + 2 * Math.PI); // behind the scanner nothing is noticed
  c.fill();
  c.restore();
}

/** The scan and the cones of the ultrasonics. */
export function drawSenses(view, world, now, ranges) {
  const [x, y, yaw, fov, beams] = world.laser, points = [];
  const [mx, my] = placed(now.pose, [x, y]), first = now.pose[2] + yaw - fov / 2;
  ranges.forEach((range, k) => {
    if (!range) return;
    const angle = first + (fov * k) / Math.max(1, beams - 1), metres = range / 1000;
    points.push([mx + metres * Math.cos(angle), my + metres * Math.sin(angle)]);
  });
  view.dots(points, view.colour.scan);
  const c = view.context;
  world.cones.forEach(([cx, cy, turn, angle], k) => {
    const range = now.sonar[k];
    if (range === null || range > 2.5) return;
    const [ux, uy] = placed(now.pose, [cx, cy]), at = now.pose[2] + turn;
    c.beginPath(); c.moveTo(ux, uy); c.arc(ux, uy, range, at - angle / 2, at + angle / 2); c.closePath();
    c.globalAlpha = 0.25; c.fillStyle = view.colour.cone; c.fill(); c.globalAlpha = 1;
    c.strokeStyle = view.colour.cone; c.lineWidth = view.pixel; c.stroke();
  });
}
