// Runs Khronos' glTF validator over GLB files: no error, no warning.
//   node validate_gltf.mjs NODE_MODULES FILE.glb...
// NODE_MODULES is the folder into which npm has installed gltf-validator.
import fs from 'node:fs';
import {createRequire} from 'node:module';
import path from 'node:path';

const [modules, ...files] = process.argv.slice(2);
const validator = createRequire(import.meta.url)(path.resolve(modules, 'gltf-validator'));

let failed = files.length === 0 ? 1 : 0;
for (const file of files) {
  const report = await validator.validateBytes(new Uint8Array(fs.readFileSync(file)), {uri: path.basename(file)});
  const {numErrors, numWarnings, messages} = report.issues;
  const good = numErrors === 0 && numWarnings === 0 && report.info.drawCallCount > 0;
  if (!good) ++failed;
  console.log(`${good ? 'ok     ' : 'FAILED '} ${path.basename(file)}: ${numErrors} errors, ${numWarnings} warnings, ` +
              `${report.info.totalTriangleCount} triangles`);
  for (const {code, message, pointer, severity} of messages) {
    console.log(`        ${severity} ${code} ${pointer ?? ''} ${message}`);
  }
}
process.exit(failed === 0 ? 0 : 1);
