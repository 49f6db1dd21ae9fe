// Runs a network of realism_networks.cjs on images that come one after the other, for detectors.py.
//
//     node detectors.cjs NODE_MODULES centernet|nanodet SIDE
//
// stdin has images of SIDE x SIDE pixels, 3 bytes a pixel; stdout gets a line for each: {output: [numbers]}.
"use strict";
const fs = require("fs");
const { ready } = require("./realism_networks.cjs");

const side = Number(process.argv[4]);

// Fills a whole image from stdin; nothing when it has ended.
function next() {
  const bytes = new Uint8Array(side * side * 3);
  let at = 0;
  while (at < bytes.length) {
    let n = 0;
    try {
      n = fs.readSync(0, bytes, at, bytes.length - at);
    } catch (error) {
      if (error.code === "EAGAIN") continue;
      if (error.code !== "EOF") throw error;
    }
    if (n === 0) return null;
    at += n;
  }
  return bytes;
}

async function main() {
  // What a library prints belongs to the log, not to the answers.
  console.log = console.info = console.error;
  const answer = await ready();
  for (let bytes = next(); bytes !== null; bytes = next()) fs.writeSync(1, JSON.stringify(answer(bytes, side)) + "\n");
}

main();
