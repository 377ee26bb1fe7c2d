// Requests to the program. An error has the sentence for the person in its message.

async function answerOf(path, options = {}) {
  let response;
  try {
    response = await fetch(path, options);
  } catch {
    throw new Lost();
  }
  const values = await response.json().catch(() => ({ error: `${response.status} ${response.statusText}` }));
  if (!response.ok) throw new Error(values.error ?? `${response.status} ${response.statusText}`);
  return values;
}

export class Lost extends Error {
  constructor() {
    super("The program does not answer. Start it again with the same command.");
  }
}

export const state = () => answerOf("state");
export const training = () => answerOf("training");
export const train = () => answerOf("train", { method: "POST" });
export const cancel = () => answerOf("cancel", { method: "POST" });
export const finish = () => answerOf("finish", { method: "POST" });
export const mark = (index, values) => answerOf(`frames/${index}`, { method: "PUT", body: JSON.stringify(values) });

const images = new Map();

export function image(path) {
  if (!images.has(path)) {
    images.set(path, new Promise((resolve, reject) => {
      const element = new Image();
      element.onload = () => resolve(element);
      element.onerror = () => { images.delete(path); reject(new Lost()); };
      element.src = path;
    }));
  }
  return images.get(path);
}
