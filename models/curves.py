"""Learning curves as a picture: one SVG, logarithmic upward, one line a figure."""
import math
from collections.abc import Mapping, Sequence
from pathlib import Path

WIDTH, HEIGHT, LEFT, RIGHT, TOP, BOTTOM = 860, 480, 60, 190, 34, 44
COLOURS = ("#1f5fa8", "#c2452d", "#2f7d4f", "#8a5aa8", "#b8860b", "#4a4a4a", "#0f8b8d", "#a83a6b")


def write_curves(path: Path, title: str, lines: Sequence[Mapping[str, float]], figures: Sequence[str]) -> None:
    """`figures` of the records `lines` over their `step`; a record that lacks a figure, or has it at 0, is passed over."""
    series = {
        name: [(line["step"], line[name]) for line in lines if line.get(name, 0) > 0 and math.isfinite(line[name])]
        for name in figures
    }
    series = {name: points for name, points in series.items() if points}
    values = [value for points in series.values() for _, value in points]
    if not values:
        return
    low, high = math.floor(math.log10(min(values))), math.ceil(math.log10(max(values)))
    high = max(high, low + 1)
    last = max(step for points in series.values() for step, _ in points)

    def x(step: float) -> float:
        return LEFT + (WIDTH - LEFT - RIGHT) * step / last

    def y(value: float) -> float:
        return TOP + (HEIGHT - TOP - BOTTOM) * (high - math.log10(value)) / (high - low)

    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" font-family="sans-serif" font-size="12">',
        f'<rect width="{WIDTH}" height="{HEIGHT}" fill="white"/><text x="{LEFT}" y="20" font-size="14">{title}</text>',
    ]
    for power in range(low, high + 1):
        at = y(10.0**power)
        parts.append(f'<path d="M{LEFT} {at:.1f}H{WIDTH - RIGHT}" stroke="#ddd"/>')
        parts.append(f'<text x="{LEFT - 8}" y="{at + 4:.1f}" text-anchor="end">{10.0**power:g}</text>')
    for quarter in range(5):
        step = last * quarter / 4
        parts.append(f'<text x="{x(step):.1f}" y="{HEIGHT - BOTTOM + 18}" text-anchor="middle">{step:.0f}</text>')
    parts.append(f'<text x="{(LEFT + WIDTH - RIGHT) / 2}" y="{HEIGHT - 8}" text-anchor="middle">step</text>')
    for k, (name, points) in enumerate(series.items()):
        colour = COLOURS[k % len(COLOURS)]
        way = "L".join(f"{x(step):.1f} {y(value):.1f}" for step, value in points)
        parts.append(f'<path d="M{way}" fill="none" stroke="{colour}" stroke-width="1.6"/>')
        label = f"{name} {points[-1][1]:.4g}"
        parts.append(f'<text x="{WIDTH - RIGHT + 10}" y="{TOP + 16 * k + 10}" fill="{colour}">{label}</text>')
    path.write_text("\n".join([*parts, "</svg>"]) + "\n")
