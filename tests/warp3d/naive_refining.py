"""Votes of samples around others, counted one by one; shares no code with the kernels."""

import math


def weighted_median(value, weight):
    """The smallest value at which half of the weight is reached."""
    half, reached = 0.5 * sum(weight), 0.0
    for v, w in sorted(zip(value, weight, strict=True)):
        reached += w
        if reached >= half:
            return v
    return max(value)


def change(slope, bend, away):
    """Change along an axis: a parabola, or a + b √(T − t) where the surface turns away."""
    if slope * away >= 0 or bend >= 0:
        return slope * away + bend * away * away / 2
    slope, away = -abs(slope), abs(away)
    turn = max(slope / bend / 2, 1.0)
    b = -2 * slope * math.sqrt(turn)  # so that the slope at 0 is −b / (2 √T)
    return b * (math.sqrt(max(turn - away, 0.0)) - math.sqrt(turn))


def votes(color, nearness, trust, slope, at, first):
    """(value, share, asked, close) of every sample up to 8 px away that votes, or of the first."""
    row, column = at
    found = []
    for r in range(max(0, row - 8), min(len(nearness), row + 9)):
        for c in range(max(0, column - 8), min(len(nearness[0]), column + 9)):
            down, across = abs(r - row), abs(c - column)
            is_near = max(down, across) <= 4 or min(down, across) == 0
            if not trust[r][c] > 0 or not (is_near or (down % 2 == 0 and across % 2 == 0)):
                continue
            is_first = max(down, across) <= 2 or min(down, across) == 0
            if first and not is_first and (down % 4 or across % 4):
                continue
            apart = sum(
                (float(a) - float(b)) ** 2
                for a, b in zip(color[row][column], color[r][c], strict=True)
            )
            alike = (math.exp(-apart / 2) if apart < 40 else 0.0) + 1e-4
            squared = down**2 + across**2
            x, y = column - c, row - r
            s = [float(n) for n in slope[r][c]]
            there = float(nearness[r][c])
            value = there + change(s[0], s[2], x) + change(s[1], s[3], y)
            asked = float(trust[r][c]) * math.exp(-squared / 32)
            close = (1.0 if trust[r][c] == 1 else 1e-4) * alike
            close *= math.exp(-squared / 8 - 0.5 * min(down, across) ** 2)
            found.append((max(value, 0.3 * there), asked * alike, asked, close))
    return found


def vote(color, nearness, trust, slope, at):
    """Nearness that a sample gets, and how far the votes agree: the first, or else all."""
    near, agreed = counted(nearness, trust, at, votes(color, nearness, trust, slope, at, True))
    if agreed >= 0.995:
        return near, agreed
    return counted(nearness, trust, at, votes(color, nearness, trust, slope, at, False))


def counted(nearness, trust, at, found):
    if not found:
        return 0.0, 0.0
    value, share, asked, _ = zip(*found, strict=True)
    middle = weighted_median(value, share)
    reach = 0.25 * (max(value) - min(value)) + 0.01 * middle
    same = [each for each in found if abs(each[0] - middle) <= reach]
    agreed = sum(each[1] for each in same) / sum(share)
    agreed *= min(1.0, sum(share) / (0.05 * sum(asked)))
    here = float(nearness[at[0]][at[1]])
    if trust[at[0]][at[1]] > 0 and abs(here - middle) <= reach:
        return here, agreed
    return weighted_median([each[0] for each in same], [each[3] for each in same]), agreed
