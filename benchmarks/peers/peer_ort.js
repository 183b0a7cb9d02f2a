// ONNX Runtime by the line protocol of README.md:
//   node peer_ort.js MODEL.onnx CASE.safetensors THREADS [--no-spinning]
//   node peer_ort.js --fold MODEL.onnx FOLDED.onnx        constants computed, nothing specific to a machine
// onnxruntime-node is looked for in OUT/node, where run.sh installs it.
'use strict';
const fs = require('fs');
const path = require('path');

const folding = process.argv[2] === '--fold';
const [model, caseFile, threads] = process.argv.slice(folding ? 3 : 2);
const folder = path.join(path.dirname(path.resolve(model)), 'node', 'node_modules', 'onnxruntime-node');
const ort = require(folder);

function status(key) {
  const line = fs.readFileSync('/proc/self/status', 'utf8').split('\n').find((l) => l.startsWith(key + ':'));
  return line ? parseInt(line.split(/\s+/)[1], 10) : 0;
}

function inputsOf(file) {
  const raw = fs.readFileSync(file);
  const length = Number(raw.readBigUInt64LE(0));
  const header = JSON.parse(raw.toString('utf8', 8, 8 + length));
  const feeds = {};
  for (const [name, entry] of Object.entries(header)) {
    if (!name.startsWith('input.')) continue;
    const [begin, end] = entry.data_offsets;
    const bytes = new Uint8Array(raw.subarray(8 + length + begin, 8 + length + end));
    feeds[name.slice(6)] = new ort.Tensor('float32', new Float32Array(bytes.buffer), entry.shape);
  }
  return feeds;
}

function say(message) {
  process.stdout.write(JSON.stringify(message) + '\n');
}

async function main() {
  if (folding) {
    const options = {graphOptimizationLevel: 'basic', optimizedModelFilePath: caseFile, logSeverityLevel: 3};
    await ort.InferenceSession.create(model, options);
    process.exit(0);
  }
  const options = {
    intraOpNumThreads: Number(threads), interOpNumThreads: 1, executionMode: 'sequential', graphOptimizationLevel: 'all',
    logSeverityLevel: 3,
  };
  if (process.argv.includes('--no-spinning')) options.extra = {session: {intra_op: {allow_spinning: '0'}}};
  const feeds = inputsOf(caseFile);
  const base = status('VmHWM');
  let start = process.hrtime.bigint();
  const session = await ort.InferenceSession.create(model, options);
  const load = Number(process.hrtime.bigint() - start) / 1e6;
  const facts = () => ({
    load_ms: load, base_kib: base, peak_kib: status('VmHWM'), threads: Number(threads),
    version: 'ONNX Runtime ' + JSON.parse(fs.readFileSync(path.join(folder, 'package.json'), 'utf8')).version,
  });
  say(facts());
  let result = {};
  for await (const line of require('readline').createInterface({input: process.stdin})) {
    if (line === 'quit') break;
    if (line === 'run') {
      start = process.hrtime.bigint();
      result = await session.run(feeds);
      say({ms: Number(process.hrtime.bigint() - start) / 1e6});
    } else if (line.startsWith('output ')) {
      const data = session.outputNames.map((name) => result[name].data);
      fs.writeFileSync(line.slice(7), Buffer.concat(data.map((d) => Buffer.from(d.buffer, d.byteOffset, d.byteLength))));
      say({});
    } else if (line === 'facts') {
      say(facts());
    } else if (line === 'scalars') {
      say(Object.fromEntries(session.outputNames.map((name) => [name, result[name].data[0]])));
    }
  }
  process.exit(0);
}

main().catch((error) => {
  say({error: String(error.message || error)});
  process.exit(1);
});
