// Print what MCAP's own TypeScript reader finds in a recording, as JSON.
import { readFile } from "node:fs/promises";
import { McapStreamReader } from "@mcap/core";
import { decompress } from "fzstd";
import protobuf from "protobufjs";
import descriptor from "protobufjs/ext/descriptor/index.js";

const decompressHandlers = {
  zstd: (data, size) => decompress(data, new Uint8Array(Number(size))),
};
const reader = new McapStreamReader({ decompressHandlers, validateCrcs: true });
reader.append(await readFile(process.argv[2]));
const types = new Map(), channels = new Map();
const found = { messages: {}, schemas: {}, xi_m: [], events: [], attachments: {}, result: {} };
for (let record; (record = reader.nextRecord()); ) {
  if (record.type === "Schema") {
    const root = protobuf.Root.fromDescriptor(descriptor.FileDescriptorSet.decode(record.data));
    types.set(record.id, root.lookupType(record.name));
  } else if (record.type === "Channel") {
    channels.set(record.id, { topic: record.topic, type: types.get(record.schemaId) });
  } else if (record.type === "Message") {
    const { topic, type } = channels.get(record.channelId);
    const content = type.toObject(type.decode(record.data), { enums: String });
    found.messages[topic] = (found.messages[topic] ?? 0) + 1;
    found.schemas[topic] = type.fullName.slice(1);
    if (topic === "/truth") found.xi_m.push(...content.xi_m);
    if (topic === "/events") found.events.push([content.message, content.kind]);
  } else if (record.type === "Attachment") {
    found.attachments[record.name] = new TextDecoder().decode(record.data);
  } else if (record.type === "Metadata" && record.name === "result") {
    found.result = Object.fromEntries(record.metadata);
  }
}
if (!reader.done()) throw new Error("the file does not end where it should");
console.log(JSON.stringify(found));
