// Contacts: of each nine points, five are the edge of the sole, two the ends of the force, and the others gaps
{
  const {names, longest} = robot.contacts, lines = array(robot.contacts.lines), POINTS = 9, START = 6, END = 7;
  const forceAt = (frame, k) => [0, 1, 2].map(side => {
    const first = 3 * POINTS * (frame * names.length + k) + side;
    return lines[first + 3 * END] - lines[first + 3 * START];
  });
  const sizes = names.map((_, k) => [...times.keys()].map(frame => Math.hypot(...forceAt(frame, k))));
  const scale = longest / Math.max(...sizes.flat().filter(x => x > 0)); // NaN where a contact carries nothing

  const contactPoints = frame => {
    const count = 3 * POINTS * names.length, found = lines.slice(frame * count, frame * count + count);
    names.forEach((_, k) => forceAt(frame, k).forEach((x, side) => {
      found[3 * (POINTS * k + END) + side] = found[3 * (POINTS * k + START) + side] - scale * x; // from below: the leg would hide it
    }));
    return [0, 1, 2].map(side => found.filter((_, k) => k % 3 === side));
  };

  if (names.length) {
    const [x, y, z] = contactPoints(cursor), ends = names.flatMap(() => [...Array(POINTS).keys()].map(k => 8 * (k === START)));
    const look = {line: {color: "#d55e00", width: 7}, marker: {color: "#d55e00", size: ends, opacity: 1, line: {width: 0}}};
    const zmp = array(robot.zmp), zmpPoint = frame => [0, 1, 2].map(side => [zmp[3 * frame + side]]); // NaN in flight
    const [zmpX, zmpY, zmpZ] = zmpPoint(cursor), zmpLook = {color: "#0000e0", size: 8, opacity: 1, line: {width: 0}};
    Plotly.addTraces(drawing, [
      {type: "scatter3d", mode: "markers", x: zmpX, y: zmpY, z: zmpZ, marker: zmpLook, hoverinfo: "skip"},
      {type: "scatter3d", mode: "lines+markers", x, y, z, ...look, hoverinfo: "skip"},
    ]);
    document.addEventListener("cursor", ({detail: frame}) => {
      const [x, y, z] = zmpPoint(frame).map((points, side) => [points, contactPoints(frame)[side]]), last = drawing.data.length - 1;
      Plotly.restyle(drawing, {x, y, z}, [last - 1, last]);
    });
    const axis = {gridcolor: "#e6e6e6", zeroline: false, linecolor: "#222222", ticks: "outside"};
    Plotly.newPlot("contact-forces", names.map((name, k) => ({x: times, y: sizes[k], name, mode: "lines"})), {
      height: 220, margin: figures[0].layout.margin, font: figures[0].layout.font, legend: {orientation: "h", y: 1.02, yanchor: "bottom"},
      paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)", dragmode: false,
      colorway: ["#0072b2", "#d55e00", "#009e73", "#cc79a7"],
      xaxis: {...axis, title: {text: "t [s]"}}, yaxis: {...axis, title: {text: "force [N]"}, rangemode: "tozero"},
    }, OPTIONS);
  }
}
