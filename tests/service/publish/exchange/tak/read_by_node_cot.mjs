// Reads events, one a line in base64, and prints node-cot's GeoJSON of each as a line of JSON. In an empty folder:
//   npm install @tak-ps/node-cot@12.23.0 && node read_by_node_cot.mjs < EVENTS
// test_cot.py runs it where DISTLOC_NODE_COT names such a folder; node-cot.json holds what it printed last.
import readline from "node:readline";
import CoT from "@tak-ps/node-cot";

for await (const line of readline.createInterface({ input: process.stdin })) {
  console.log(JSON.stringify(new CoT(Buffer.from(line, "base64")).to_geojson()));
}
