// Validates the GLB of `plnerf export RUN --format glb` by Khronos' validator, and sorts what it finds.
//
//     npm install gltf-validator && node benchmarks/check_glb.mjs splats.glb [validator's package]
//
// Run in the folder of node_modules.  The validator takes names that it does not know for mistakes, also those
// that KHR_gaussian_splatting prescribes.  So the file is validated twice: as it is, and with these names, and
// nothing else, written as names of an application are.  Status 0: of the first it says that it does not know
// the extension, and calls these names invalid, each once; of the second it calls nothing wrong.

import { readFileSync } from "node:fs";
import { createRequire } from "node:module";

const [path, name = "gltf-validator"] = process.argv.slice(2);
const validator = createRequire(`${process.cwd()}/`)(name);
const EXTENSION = "KHR_gaussian_splatting";
const HARMONICS = "SH_DEGREE_(0_COEF_0|1_COEF_[0-2]|2_COEF_[0-4]|3_COEF_[0-6])";
const PRESCRIBED = new RegExp(`^${EXTENSION}:(ROTATION|SCALE|OPACITY|${HARMONICS})$`);
const INVALID = "MESH_PRIMITIVE_INVALID_ATTRIBUTE";
const SEVERITIES = ["error", "warning", "information", "hint"];

const file = readFileSync(path);
const length = file.readUInt32LE(12);
const content = JSON.parse(file.subarray(20, 20 + length).toString());
const primitive = content.meshes[0].primitives[0];
const prescribed = Object.keys(primitive.attributes).filter((one) => PRESCRIBED.test(one));

const asItIs = await found(file, "as it is");
const ofApplication = (key) => (PRESCRIBED.test(key) ? `_${key.split(":")[1]}` : key);
primitive.attributes = Object.fromEntries(
    Object.entries(primitive.attributes).map(([key, at]) => [ofApplication(key), at]),
);
const renamed = await found(glb(content, file.subarray(20 + length)), "with names of an application");

const names = asItIs.filter((one) => one.code === INVALID).map((one) => one.pointer.split("/").pop());
const others = asItIs.filter((one) => one.code !== INVALID && !unknown(one));
const same = names.toSorted().join() === prescribed.toSorted().join();
const good = same && others.length === 0 && renamed.every(unknown);
console.log(`${prescribed.length} prescribed names, ${names.length} names called invalid`);
console.log(good ? "nothing else is found" : `ELSE: ${JSON.stringify({ names, others, renamed }, null, 1)}`);
process.exit(good ? 0 : 1);

/** What the validator says of a GLB, printed in short. */
async function found(data, what) {
    const report = await validator.validateBytes(new Uint8Array(data), { maxIssues: 0, format: "glb" });
    console.log(`${name} ${report.validatorVersion}, ${what}:`);
    for (const one of report.issues.messages) {
        console.log(`  ${SEVERITIES[one.severity]} ${one.code} ${one.pointer ?? ""}`);
    }
    return report.issues.messages;
}

/** Whether an issue says no more than that the validator does not know the extension. */
function unknown(one) {
    return one.code === "UNSUPPORTED_EXTENSION" && one.message.includes(EXTENSION);
}

/** A GLB of some content and the chunk after it. */
function glb(json, rest) {
    const text = JSON.stringify(json);
    const chunk = Buffer.from(text.padEnd(Math.ceil(Buffer.byteLength(text) / 4) * 4));
    const head = Buffer.alloc(20);
    head.write("glTF");
    head.writeUInt32LE(2, 4);
    head.writeUInt32LE(20 + chunk.length + rest.length, 8);
    head.writeUInt32LE(chunk.length, 12);
    head.write("JSON", 16);
    return Buffer.concat([head, chunk, rest]);
}
