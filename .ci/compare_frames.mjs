// compare_frames.mjs A.y4m B.y4m: two builds draw the same. Of all samples at least 99.9 % differ by at most 1.
import { readFileSync } from 'node:fs';

function frames(path) {
  const file = readFileSync(path);
  const lineEnd = file.indexOf(0x0a);
  const header = file.subarray(0, lineEnd).toString();
  const marker = Buffer.from('FRAME\n');
  const parts = [];
  for (let at = lineEnd + 1; at < file.length; ) {
    if (!file.subarray(at, at + marker.length).equals(marker)) throw new Error(`${path}: no frame at byte ${at}`);
    const start = at + marker.length;
    const size = parts.length > 0 ? parts[0].length : sizeOf(header);
    parts.push(file.subarray(start, start + size));
    at = start + size;
  }
  return { header, parts };
}

function sizeOf(header) {
  const width = Number(/ W(\d+)/.exec(header)[1]);
  const height = Number(/ H(\d+)/.exec(header)[1]);
  const space = / C(\S+)/.exec(header)[1];
  if (space.startsWith('444')) return 3 * width * height;
  return width * height + 2 * Math.ceil(width / 2) * Math.ceil(height / 2);
}

const [a, b] = process.argv.slice(2).map(frames);
if (a.header !== b.header || a.parts.length !== b.parts.length || a.parts.length === 0) {
  console.error(`the files differ in size or number of frames: "${a.header}" and "${b.header}"`);
  process.exit(1);
}
let total = 0;
let apart = 0;
let largest = 0;
a.parts.forEach((frame, k) => {
  for (let i = 0; i < frame.length; ++i) {
    const d = Math.abs(frame[i] - b.parts[k][i]);
    largest = Math.max(largest, d);
    apart += d > 1 ? 1 : 0;
  }
  total += frame.length;
});
console.log(`${a.parts.length} frames, ${((100 * apart) / total).toFixed(4)} % of the samples differ by more than 1, at most ${largest}`);
process.exit(apart <= 0.001 * total ? 0 : 1);
