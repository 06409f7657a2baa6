// The station's video by WebRTC, each presented picture with the number of its frame.

const UNKNOWN_FRAMES = 40; // in a row: what is presented cannot be told apart any more
const KEPT = 300;

let current = null;

/**
 * Play into the <video>. onframe(seq, image): this frame is presented now, and this is what to draw of it: a VideoFrame,
 * which the receiver closes, or the <video>. Pictures whose number is not known are left out. onend(why): it has ended
 * by itself. Throws an Error with the reason where it cannot be had.
 */
export async function start(video, onframe, onend = () => {}) {
  stop();
  const connection = new RTCPeerConnection(); // no STUN: same machine or same network
  const mine = { connection, video };
  current = mine;
  const end = (why) => {
    if (current !== mine) return;
    stop();
    onend(why);
  };
  connection.addTransceiver("video", { direction: "recvonly" });
  const numbers = new Map(); // RTP timestamp: frame number
  const channel = connection.createDataChannel("frames", { ordered: false, maxRetransmits: 0 });
  channel.onmessage = ({ data }) => learn(numbers, JSON.parse(data));
  connection.ontrack = ({ receiver, track }) => {
    receiver.jitterBufferTarget = 0; // the newest picture, not the smoothest film
    receiver.playoutDelayHint = 0;
    video.srcObject = new MediaStream([track]);
    video.muted = true;
    video.play().catch(() => {}); // put off by the browser, or ended by stop()
  };
  connection.onconnectionstatechange = () => {
    if (["failed", "closed"].includes(connection.connectionState)) end("the connection has ended");
  };
  follow(video, () => current === mine, numbers, onframe, end);
  try {
    await agree(connection);
  } catch (error) {
    if (current === mine) stop();
    throw error;
  }
}

/** End it; nothing is told after that. */
export function stop() {
  if (current === null) return;
  const { connection, video } = current;
  current = null;
  connection.close();
  video.srcObject = null;
}

async function agree(connection) {
  await connection.setLocalDescription();
  await gathered(connection);
  const answer = await fetch("/webrtc", {
    method: "POST",
    headers: { "Content-Type": "application/sdp" },
    body: connection.localDescription.sdp,
  });
  const text = await answer.text();
  if (!answer.ok) throw new Error(text || `the station answers ${answer.status}`);
  await connection.setRemoteDescription({ type: "answer", sdp: text });
}

function gathered(connection) {
  return new Promise((resolve) => {
    const look = () => connection.iceGatheringState === "complete" && resolve();
    connection.addEventListener("icegatheringstatechange", look);
    look();
  });
}

function learn(numbers, pairs) {
  for (const [timestamp, seq] of pairs) numbers.set(timestamp, seq);
  for (const timestamp of numbers.keys()) {
    if (numbers.size <= KEPT) break;
    numbers.delete(timestamp); // the oldest
  }
}

function follow(video, isOn, numbers, onframe, end) {
  let unknown = 0;
  const presented = (_, metadata) => {
    if (!isOn()) return;
    video.requestVideoFrameCallback(presented);
    const picture = pictureOf(video);
    const seq = numbers.get(picture === null ? metadata.rtpTimestamp : picture.metadata().rtpTimestamp);
    unknown = seq === undefined ? unknown + 1 : 0;
    if (seq === undefined) picture?.close();
    else onframe(seq, picture ?? video);
    if (unknown > UNKNOWN_FRAMES) end("its pictures come without their numbers");
  };
  video.requestVideoFrameCallback(presented);
}

/** The picture that the <video> shows at this moment, which on a busy machine may be one after that of the callback;
 * null where the browser gives none that knows its RTP timestamp. */
function pictureOf(video) {
  if (globalThis.VideoFrame?.prototype.metadata === undefined) return null;
  const picture = new VideoFrame(video);
  if (picture.metadata().rtpTimestamp !== undefined) return picture;
  picture.close();
  return null;
}
