// Arrays from the server: length of the header, the header as JSON, then 32-bit floats; see frames.py.
export const readFrame = (buffer) => {
  const length = new DataView(buffer).getUint32(0, true);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
  const arrays = {};
  let at = 4 + length;
  for (const { name, shape } of header.arrays) {
    const count = shape.reduce((product, size) => product * size, 1);
    arrays[name] = { shape, values: new Float32Array(buffer, at, count) };
    at += 4 * count;
  }
  return { header, arrays };
};

// Row `index` of a two-dimensional array for a plot: missing values are null.
export const row = ({ shape, values }, index) => {
  const width = shape[1];
  return Array.from(values.subarray(index * width, (index + 1) * width), (value) => (Number.isNaN(value) ? null : value));
};
