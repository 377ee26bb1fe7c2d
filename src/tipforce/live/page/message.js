// Reads the binary message of one frame: header, JSON, JPEG. The layout is described in live/server/_messages.py.

const MAGIC = 0x46504954; // "TIPF", little endian
const VERSION = 1;

/**
 * @param {ArrayBuffer} buffer one message
 * @returns {{number: number, capturedMs: number, publishedMs: number, values: object, jpeg: Uint8Array|null}}
 *     times in milliseconds on the engine's clock
 */
export function readMessage(buffer) {
  const view = new DataView(buffer);
  if (view.getUint32(0, true) !== MAGIC || view.getUint16(4, true) !== VERSION) {
    throw new Error("the server speaks another version: load this page again");
  }
  const header = view.getUint16(6, true);
  const jsonBytes = view.getUint32(28, true);
  const jpegBytes = view.getUint32(32, true);
  const text = new TextDecoder().decode(new Uint8Array(buffer, header, jsonBytes));
  return {
    number: view.getUint32(8, true),
    capturedMs: Number(view.getBigInt64(12, true)) / 1e6,
    publishedMs: Number(view.getBigInt64(20, true)) / 1e6,
    values: JSON.parse(text),
    jpeg: jpegBytes ? new Uint8Array(buffer, header + jsonBytes, jpegBytes) : null,
  };
}
