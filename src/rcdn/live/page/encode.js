// A thread of its own: pictures come in, JPEGs go out, while the page goes on drawing.

const QUALITY = 0.92;
let canvas = null;

onmessage = async ({ data: { picture, number, time } }) => {
  const width = picture.displayWidth ?? picture.width, height = picture.displayHeight ?? picture.height;
  if (canvas?.width !== width || canvas?.height !== height) canvas = new OffscreenCanvas(width, height);
  canvas.getContext("2d", { alpha: false, willReadFrequently: true }).drawImage(picture, 0, 0);
  picture.close();
  const blob = await canvas.convertToBlob({ type: "image/jpeg", quality: QUALITY });
  const jpeg = await blob.arrayBuffer();
  postMessage({ jpeg, number, time }, [jpeg]);
};
