// A thread of its own: pictures come in, JPEGs go out, while the page goes on drawing.

const QUALITY = 0.92;
const canvases = [];

// A part of a picture as JPEG: from `at` on, a share `wide` of its width.
async function encoded(k, picture, at, wide) {
  const width = Math.floor((picture.displayWidth ?? picture.width) * wide), height = picture.displayHeight ?? picture.height;
  if (canvases[k]?.width !== width || canvases[k]?.height !== height) canvases[k] = new OffscreenCanvas(width, height);
  canvases[k].getContext("2d", { alpha: false, willReadFrequently: true }).drawImage(picture, -width * at, 0);
  const blob = await canvases[k].convertToBlob({ type: "image/jpeg", quality: QUALITY });
  return blob.arrayBuffer();
}

onmessage = async ({ data: { pictures, halves, number, times } }) => {
  const parts = halves ? [[pictures[0], 0, 0.5], [pictures[0], 1, 0.5]] : pictures.map((picture) => [picture, 0, 1]);
  const jpegs = await Promise.all(parts.map((part, k) => encoded(k, ...part)));
  pictures.forEach((picture) => picture.close());
  postMessage({ jpegs, number, times }, jpegs);
};
