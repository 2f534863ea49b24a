// The stream of the server: reconnects by itself, with the same link also to a stack that was started again.

const token = new URLSearchParams(location.search).get("token") ?? "";

/** The numbers in a base64 text; each sensor sends arrays as bytes. */
function numbers(text, Kind) {
  const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  return new Kind(bytes.buffer);
}

function decoded(frame) {
  return frame && { ...frame, force: numbers(frame.force, Float32Array), deviation: numbers(frame.deviation, Float32Array), status: numbers(frame.status, Uint8Array) };
}

/** Tells why the stream is refused, such as too many pages, and tries again. */
async function refused(handlers) {
  setTimeout(() => listen(handlers), 2000);
  const response = await fetch(`stream?token=${encodeURIComponent(token)}`).catch(() => null);
  if (response && !response.ok) handlers.connection(false, await response.text());
  else response?.body.cancel();
}

/** Calls the handlers `setup`, `diagnostics`, `frame` with what arrives, and `connection` with true or false. */
export function listen(handlers) {
  const source = new EventSource(`stream?token=${encodeURIComponent(token)}`);
  source.onopen = () => handlers.connection(true);
  source.onerror = () => {
    handlers.connection(false);
    if (source.readyState === EventSource.CLOSED) refused(handlers); // the browser has given up
  };
  source.addEventListener("setup", (event) => handlers.setup(JSON.parse(event.data)));
  source.addEventListener("diagnostics", (event) => handlers.diagnostics(JSON.parse(event.data)));
  source.addEventListener("frame", (event) => handlers.frame(JSON.parse(event.data).map(decoded)));
}

/** Calls a service of a sensor; returns whether it succeeded and its message. */
export async function call(sensor, action, argument) {
  try {
    const response = await fetch("action", {
      method: "POST",
      headers: { "Content-Type": "application/json", "X-Posfet-Token": token },
      body: JSON.stringify({ sensor, action, argument }),
    });
    return { success: response.ok, message: await response.text() };
  } catch {
    return { success: false, message: "the stack does not answer: is it still running?" };
  }
}
