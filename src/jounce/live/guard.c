/* A guard follows a path tick by tick within limits, as jounce.Robot.guard does. No memory is allocated, and the work of
 * a tick is bounded: guard_CHECKS states of 2 guard_TERMS + 20 multiply-adds. After guard_start(&guard_motion, &g), each
 * guard_step(&guard_motion, &g, setpoint) is a tick: q = q(s), qd = q' v, q2d = q' a + q'' v v, q3d = q' j + 3 q'' v a
 * + q''' v v v, with the planned motion q(s). Set points below 0 or not a number count as 0, those above 1 as 1.
 * Compile with -ffp-contract=off for results that do not depend on optimization. */
typedef struct {
    int nodes, rests; /* whether the motion ends at rest */
    const double *s, *factors, *stop_speed; /* [nodes], [nodes][TERMS], [LAWS][nodes] */
} guard_path;

typedef struct { /* s, v, a at this tick, v = 1 being the speed of the motion; j begins here */
    double s, v, a, j, at;      /* where on the path the set point would break a limit */
    int status, limit, checks;  /* guard_FOLLOW, ...; which row of the limits, or -1; how many states were checked */
    double next[3];
    double slow;
    int cell, law;
} guard_state;

enum { guard_FOLLOW, guard_LIMITED, guard_STUCK, guard_END };

static void guard_advance(const double *law, double x[3], double r)
{
    const double u = x[1] - r, c = x[2] + law[0] * u;
    x[0] += r * guard_dt + u * law[2] + c * law[3];
    x[1] = r + (u + c * guard_dt) * law[1];
    x[2] = (x[2] - law[0] * c * guard_dt) * law[1];
}

static double guard_jerk(const double *law, const double x[3], double r)
{
    return -law[0] * (2 * x[2] + law[0] * (x[1] - r));
}

static void guard_seek(const guard_path *path, int *cell, double s)
{
    while (*cell < path->nodes - 2 && s >= path->s[*cell + 1]) ++*cell;
}

/* Whether a state keeps every limit; of the first try, the row that does not is noted. */
static int guard_keeps(const guard_path *path, guard_state *g, int *cell, int *left, const double x[3], double j)
{
    const double v = x[1], a = x[2], p[7] = {1, v, v * v, a, v * v * v, v * a, j};
    if (--*left < 0) return 0;
    guard_seek(path, cell, x[0]);
    const double *s = path->s + *cell, w = (x[0] - s[0]) / (s[1] - s[0]);
    const double *low = path->factors + (long)*cell * guard_TERMS, *high = low + guard_TERMS;
    for (int row = 0; row < guard_ROWS; ++row) {
        double sum = 0;
        for (int t = guard_first[row]; t < guard_first[row + 1]; ++t)
            sum += (low[t] + w * (high[t] - low[t])) * p[guard_product[t]];
        if (!(sum <= guard_upper[row] && sum >= guard_lower[row])) {
            if (g->status == guard_FOLLOW) g->limit = row, g->at = x[0];
            return 0;
        }
    }
    return 1;
}

/* Whether a tick from x and the whole stop after it keep every limit and end on the path; next is the state between. */
static int guard_verify(const guard_path *path, guard_state *g, int *left, int n, double r, double top, const double x[3])
{
    const double *law = guard_laws[n], end = path->s[path->nodes - 1];
    double y[3] = {x[0], x[1], x[2]};
    int cell = g->cell;
    guard_advance(law, y, r);
    memcpy(g->next, y, sizeof y);
    if (!path->rests && y[0] + (2 * y[1] + y[2] / law[0]) / law[0] > end) return 0;
    if (y[2] + law[0] * (y[1] - top) > guard_overshoot || y[2] + law[0] * y[1] < 0) return 0;
    if (!guard_keeps(path, g, &cell, left, x, guard_jerk(law, x, r))) return 0;
    if (y[0] < end && !guard_keeps(path, g, &cell, left, y, guard_jerk(law, y, r))) return 0;
    for (; y[0] < end; guard_advance(law, y, 0)) {
        guard_seek(path, &cell, y[0]);
        if (y[2] <= 0 && y[1] <= path->stop_speed[n * path->nodes + cell]) break;
        if (!guard_keeps(path, g, &cell, left, y, guard_jerk(law, y, 0))) return 0;
    }
    return 1;
}

static inline void guard_start(const guard_path *path, guard_state *g)
{
    memset(g, 0, sizeof *g);
    g->next[0] = path->s[0];
}

static inline void guard_step(const guard_path *path, guard_state *g, double setpoint)
{
    const double end = path->s[path->nodes - 1];
    double x[3] = {g->next[0], g->next[1], g->next[2]}, r = 0;
    if (x[0] >= end) x[0] = end, x[1] = x[2] = 0;
    const int arrived = end - x[0] <= guard_end_share * (end - path->s[0]);
    const double top = arrived || !(setpoint > 0) ? 0 : setpoint < 1 ? setpoint : 1;
    const int begin = (int)(g->slow / guard_stuck_time * 10); /* each try is first in turn where it goes on too slowly */
    int left = guard_CHECKS, accepted = 0;
    guard_seek(path, &g->cell, x[0]);
    g->status = guard_FOLLOW;
    g->limit = -1;
    for (int i = 0; top > 0 && !accepted && left >= 0 && i < guard_TRIES * guard_LAWS; ++i) {
        const double *mix = guard_tries[(i / guard_LAWS + begin) % guard_TRIES];
        r = mix[0] * top + mix[1] * x[1];
        if (r > top) r = top;
        accepted = guard_verify(path, g, &left, i % guard_LAWS, r, top > x[1] ? top : x[1], x);
        if (accepted) g->law = i % guard_LAWS;
        else g->status = guard_LIMITED;
    }
    if (!accepted) { /* the stop that was verified goes on */
        r = 0;
        memcpy(g->next, x, sizeof x);
        guard_advance(guard_laws[g->law], g->next, 0);
    }
    g->status = r < top ? guard_LIMITED : guard_FOLLOW;
    g->slow = x[1] < guard_stuck_speed * top ? g->slow + guard_dt : 0;
    if (g->slow > guard_stuck_time) g->status = guard_STUCK;
    if (arrived) g->status = guard_END;
    g->s = x[0], g->v = x[1], g->a = x[2], g->j = guard_jerk(guard_laws[g->law], x, r);
    g->checks = guard_CHECKS - (left > 0 ? left : 0);
}
