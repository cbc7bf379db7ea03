/* The search of a plan by moves that do not meet, for OpenCL: the layer map and the cost of a cell are those of
 * controller/core/search/plan_surface.h, to the last bit.
 *
 * Maps have a frame of one cell, as there. A move changes the plan on one cell or two; a group of work items carries it
 * through the later layers in a window around the cell, and writes plan and surfaces if it pays. Cells of one launch lie
 * so far apart that none writes what another one reads. Sums are of whole numbers, so that their order is free. */
#pragma OPENCL EXTENSION cl_khr_fp64 : enable
#if DEVIATION
#pragma OPENCL EXTENSION cl_khr_int64_base_atomics : enable
#endif
#pragma OPENCL FP_CONTRACT OFF

/* LAYERS: horizon; KINDS: of droplets; GROUP: work items of a cell; CEILING, DEVIATION: whether these count. */
#define REACH (LAYERS + 2) /* cells from the middle of a window to its edge */
#define SIDE (2 * REACH + 1)
#define WINDOW (SIDE * SIDE)
#define TILE 16 /* cells a side that fall asleep together */
#define ABYSS -1.0

/* A droplet of a value of the plan, as in droplet_flow.h. */
typedef struct {
    double volume, spread[2], slope[2];
} Droplet;

typedef struct {
    long nx, ny, stride, framed, tiles; /* tiles: in a row of them */
    double upward, skew, ceiling_cost, chance, least_chance;
    double alpha, count, reference, least_gain;
    double height_step, square_step; /* steps of the sums [m], [m2] */
} Rules;

/* Cells whose moves are tried together: every `period` th of a layer from (ci, cj) on. */
typedef struct {
    int layer, period, ci, cj;
} Launch;

/* A change of the plan: `is` on a cell; on another one, or in another layer, `its_is`, if there are two. */
typedef struct {
    int layer, its_layer, is, its_is;
    long here, there;
    bool is_two;
} Move;

double on_lattice(double metres) {
    return (metres + 0.375) - 0.375;
}

double flow(double spread, double slope, double rise) {
    const double share = spread + on_lattice(slope * rise), raised = share > 0.0 ? share : 0.0;
    return raised < spread ? raised : spread;
}

double cost_of(constant Rules *rules, double weight, double target, double ceiling, double height, double chance) {
    const double error = height - target, size = fabs(error);
    const double expected = size < chance ? 0.5 * (error * error / chance + chance) : size;
    double cost = rules->upward * expected + rules->skew * error;
    if (CEILING && height > ceiling)
        cost += rules->ceiling_cost * (height - ceiling);
    return weight * cost;
}

double chance_of(constant Rules *rules, double kept) {
    const double own = rules->chance * kept;
    return own > rules->least_chance ? own : rules->least_chance;
}

/* Height of a cell after a layer, rows `stride` apart; kept: height that its own droplet leaves on it. */
#define PRINT(after, kept, height, value, cell, stride, droplets)                                                      \
    {                                                                                                                  \
        const constant Droplet *own = &droplets[value[cell]];                                                          \
        double lost = 0.0, got = 0.0;                                                                                  \
        for (int di = -1; di <= 1; di++)                                                                               \
            for (int dj = -1; dj <= 1; dj++) {                                                                         \
                const int place = di != 0 && dj != 0;                                                                  \
                const constant Droplet *its = &droplets[value[cell + di * stride + dj]];                               \
                const double rise = height[cell] - height[cell + di * stride + dj];                                    \
                if (di != 0 || dj != 0) {                                                                              \
                    lost += flow(own->spread[place], own->slope[place], rise);                                         \
                    got += flow(its->spread[place], its->slope[place], -rise);                                         \
                }                                                                                                      \
            }                                                                                                          \
        kept = own->volume - lost;                                                                                     \
        after = height[cell] + kept + got;                                                                             \
    }

/* Surface after one layer; in the last one also what it leaves to chance. Work items: (ny, nx). */
kernel void print_layer(constant Rules *rules, constant Droplet *droplets, global double *height,
                        global const uchar *plan, global double *chance, int layer) {
    const long cell = (get_global_id(1) + 1) * rules->stride + get_global_id(0) + 1;
    global const double *before = height + layer * rules->framed;
    global const uchar *value = plan + layer * rules->framed;
    double after, kept;
    if (get_global_id(0) >= rules->ny)
        return;
    PRINT(after, kept, before, value, cell, rules->stride, droplets);
    height[(layer + 1) * rules->framed + cell] = after;
    if (layer == LAYERS - 1)
        chance[cell] = rules->chance > 0.0 ? chance_of(rules, kept) : 0.0;
}

long steps_of(double value, double step) {
    return convert_long_rte(value / step);
}

double square_of(double height, double chance) {
    return height * height + chance * chance / 3.0;
}

#if DEVIATION
/* Sums of the heights and of their squares over the part. */
kernel void add_up(constant Rules *rules, global const double *height, global const double *chance,
                   global const uchar *part, global long *sums) {
    long heights = 0, squares = 0;
    for (long cell = get_global_id(0); cell < rules->framed; cell += get_global_size(0)) {
        const double above = height[LAYERS * rules->framed + cell] - rules->reference;
        heights += part[cell] ? steps_of(above, rules->height_step) : 0;
        squares += part[cell] ? steps_of(square_of(above, chance[cell]), rules->square_step) : 0;
    }
    atom_add(&sums[0], heights);
    atom_add(&sums[1], squares);
}

/* Change of the standard deviation by a move (objective.c). Where other cells share the launch, the change on the tangent:
 * the deviation is concave in the sums, so what their moves change together is not above the sum of these. */
double deviation_change(constant Rules *rules, global const long *sums, double height, double square) {
    const double count = rules->count, mean = sums[0] * rules->height_step / count;
    const double before = fmax(sums[1] * rules->square_step / count - mean * mean, 0.0);
    const bool is_shared = get_num_groups(0) > 1;
    const double change = (square - 2.0 * mean * height) / count - (is_shared ? 0.0 : height * height / (count * count));
    const double after = is_shared && before > 0.0 ? before : fmax(before + change, 0.0);
    const double deviations = sqrt(before) + sqrt(after);
    return deviations > 0.0 ? change / deviations : 0.0;
}
#endif

bool allows(global const ushort *choices, constant Rules *rules, int layer, long cell, int value) {
    return (2u * choices[layer * rules->framed + cell] + 1u) >> value & 1u;
}

/* Whether anything near a cell has changed since its moves were tried, by the tiles that changed in the last sweep. */
bool is_awake(constant Rules *rules, global const uchar *awake, long i, long j) {
    const long top = max(i - REACH, 0l) / TILE, bottom = min(i + REACH, rules->nx - 1) / TILE;
    const long left = max(j - REACH, 0l) / TILE, right = min(j + REACH, rules->ny - 1) / TILE;
    for (long row = top; row <= bottom; row++)
        for (long column = left; column <= right; column++)
            if (awake[row * rules->tiles + column])
                return true;
    return false;
}

/* Sums of a move. */
typedef struct {
    double change, height, square;
} Gain;

/* What a group of work items shares. */
typedef struct {
    double surface[LAYERS + 1][WINDOW], chance[WINDOW], sum[3][GROUP];
    uchar value[LAYERS][WINDOW];
} Window;

/* The maps of the problem and of the plan. */
typedef struct {
    constant Rules *rules;
    constant Droplet *droplets;
    global double *height, *chance;
    global uchar *plan;
    global const double *target, *weight, *ceiling;
    global const uchar *part;
    global const ushort *choices;
    global const long *sums;
} Maps;

/* Loads the plan with the move, and the surfaces that it meets. */
void load(const Maps *maps, const Move *move, long i, long j, local Window *window) {
    constant Rules *rules = maps->rules;
    for (int q = get_local_id(0); q < WINDOW; q += GROUP) {
        const int di = q / SIDE - REACH, dj = q % SIDE - REACH, far = max(abs(di), abs(dj));
        const long row = i + 1 + di, column = j + 1 + dj, cell = row * rules->stride + column;
        const bool is_there = row >= 0 && row <= rules->nx + 1 && column >= 0 && column <= rules->ny + 1;
        for (int layer = move->layer; layer < LAYERS && far <= REACH; layer++) {
            window->surface[layer][q] = is_there ? maps->height[layer * rules->framed + cell] : ABYSS;
            window->value[layer][q] = is_there ? maps->plan[layer * rules->framed + cell] : 0;
        }
        if (cell == move->here)
            window->value[move->layer][q] = move->is;
        if (move->is_two && cell == move->there)
            window->value[move->its_layer][q] = move->its_is;
    }
    barrier(CLK_LOCAL_MEM_FENCE);
}

/* Whether the work item's cell of a window lies on the grid, `far` from the middle at most. */
bool is_within(constant Rules *rules, long i, long j, int q, int far) {
    const int di = q / SIDE - REACH, dj = q % SIDE - REACH;
    return max(abs(di), abs(dj)) <= far && i + di >= 0 && i + di < rules->nx && j + dj >= 0 && j + dj < rules->ny;
}

long cell_of(constant Rules *rules, long i, long j, int q) {
    return (i + 1 + q / SIDE - REACH) * rules->stride + j + 1 + q % SIDE - REACH;
}

/* Cells from the middle where a surface differs after a layer. */
int reach_of(const Move *move, int layer) {
    return layer - move->layer + 1 + (move->is_two && move->here != move->there);
}

/* Carries a move through the layers, and adds up what it changes. */
Gain carry(const Maps *maps, const Move *move, long i, long j, local Window *window) {
    constant Rules *rules = maps->rules;
    const int item = get_local_id(0);
    double costs = 0.0, heights = 0.0, squares = 0.0;
    load(maps, move, i, j, window);
    for (int layer = move->layer; layer < LAYERS; layer++) {
        for (int q = item; q < WINDOW; q += GROUP) {
            double after, kept;
            if (!is_within(rules, i, j, q, reach_of(move, layer)))
                continue;
            PRINT(after, kept, window->surface[layer], window->value[layer], q, SIDE, maps->droplets);
            window->surface[layer + 1][q] = after;
            if (layer < LAYERS - 1)
                continue;
            const long cell = cell_of(rules, i, j, q);
            const double before = maps->height[LAYERS * rules->framed + cell], left = maps->chance[cell];
            const double limit = CEILING ? maps->ceiling[cell] : 0.0, target = maps->target[cell];
            const double chance = rules->chance > 0.0 ? chance_of(rules, kept) : 0.0;
            window->chance[q] = chance;
            costs += cost_of(rules, maps->weight[cell], target, limit, after, chance) -
                     cost_of(rules, maps->weight[cell], target, limit, before, left);
            if (maps->part[cell]) {
                heights += after - before;
                squares += (after - before) * ((after - rules->reference) + (before - rules->reference)) +
                           (chance * chance - left * left) / 3.0;
            }
        }
        barrier(CLK_LOCAL_MEM_FENCE);
    }
    window->sum[0][item] = costs;
    window->sum[1][item] = heights;
    window->sum[2][item] = squares;
    for (int rest = GROUP / 2; rest > 0; rest /= 2) {
        barrier(CLK_LOCAL_MEM_FENCE);
        for (int k = 0; item < rest && k < 3; k++)
            window->sum[k][item] += window->sum[k][item + rest];
    }
    barrier(CLK_LOCAL_MEM_FENCE);
    Gain gain = {window->sum[0][0] / rules->count, window->sum[1][0], window->sum[2][0]};
#if DEVIATION
    gain.change = rules->alpha * gain.change +
                  (1.0 - rules->alpha) * deviation_change(rules, maps->sums, gain.height, gain.square);
#endif
    barrier(CLK_LOCAL_MEM_FENCE);
    return gain;
}

/* Move number `number` of a cell: another value, its droplet in a later layer, or that of a neighbour. False: none. */
bool move_of(const Maps *maps, int layer, long i, long j, int number, Move *move) {
    constant Rules *rules = maps->rules;
    const int shift = number - KINDS - 1, swap = shift - (LAYERS - 1 - layer), around = swap < 4 ? swap : swap + 1;
    const long k = swap < 0 ? i : i + around / 3 - 1, l = swap < 0 ? j : j + around % 3 - 1;
    if (k < 0 || k >= rules->nx || l < 0 || l >= rules->ny)
        return false;
    const int its_layer = shift >= 0 && swap < 0 ? layer + 1 + shift : layer;
    const long here = (i + 1) * rules->stride + j + 1, there = (k + 1) * rules->stride + l + 1;
    const int was = maps->plan[layer * rules->framed + here], its = maps->plan[its_layer * rules->framed + there];
    *move = (Move){layer, its_layer, shift < 0 ? number : its, was, here, there, shift >= 0};
    return move->is != was && allows(maps->choices, rules, layer, here, move->is) &&
           (shift < 0 || allows(maps->choices, rules, its_layer, there, was));
}

/* Makes a move that has been carried. */
void make(const Maps *maps, const Move *move, long i, long j, local const Window *window, global uchar *changed) {
    constant Rules *rules = maps->rules;
    for (int q = get_local_id(0); q < WINDOW; q += GROUP) {
        const long cell = cell_of(rules, i, j, q);
        if (!is_within(rules, i, j, q, reach_of(move, LAYERS - 1)))
            continue;
        for (int layer = move->layer; layer < LAYERS; layer++)
            if (is_within(rules, i, j, q, reach_of(move, layer)))
                maps->height[(layer + 1) * rules->framed + cell] = window->surface[layer + 1][q];
        maps->chance[cell] = window->chance[q];
        changed[(cell / rules->stride - 1) / TILE * rules->tiles + (cell % rules->stride - 1) / TILE] = 1;
    }
    if (get_local_id(0) > 0)
        return;
    maps->plan[move->layer * rules->framed + move->here] = move->is;
    if (move->is_two)
        maps->plan[move->its_layer * rules->framed + move->there] = move->its_is;
}

/* Makes the best move of a cell, if it pays; a group for each cell. awake, changed: tiles that changed in the last
 * sweep and in this one; sums: those before the launch; sums_after: they are changed; made: counts the moves. */
kernel __attribute__((reqd_work_group_size(GROUP, 1, 1))) void
try_moves(constant Rules *rules, constant Droplet *droplets, global const Launch *launches, int number,
          global double *height, global uchar *plan, global double *chance, global const double *target,
          global const double *weight, global const double *ceiling, global const uchar *part,
          global const ushort *choices, global const uchar *awake, global uchar *changed, global const long *sums,
          global long *sums_after, global int *made) {
    local Window window;
    const Maps maps = {rules, droplets, height, chance, plan, target, weight, ceiling, part, choices, sums};
    global const Launch *launch = &launches[number];
    const long columns = (rules->ny - launch->cj + launch->period - 1) / launch->period;
    const long i = get_group_id(0) / columns * launch->period + launch->ci;
    const long j = get_group_id(0) % columns * launch->period + launch->cj;
    const int count = KINDS + 1 + (LAYERS - 1 - launch->layer) + 8;
    Gain best = {-rules->least_gain, 0.0, 0.0};
    int chosen = -1;
    Move move;
    if (i >= rules->nx || !is_awake(rules, awake, i, j))
        return;
    for (int number = 0; number < count; number++) {
        if (!move_of(&maps, launch->layer, i, j, number, &move))
            continue;
        const Gain gain = carry(&maps, &move, i, j, &window);
        if (gain.change < best.change) {
            best = gain;
            chosen = number;
        }
    }
    if (chosen < 0)
        return;
    move_of(&maps, launch->layer, i, j, chosen, &move);
    carry(&maps, &move, i, j, &window);
    make(&maps, &move, i, j, &window, changed);
    if (get_local_id(0) > 0)
        return;
#if DEVIATION
    atom_add(&sums_after[0], steps_of(best.height, rules->height_step));
    atom_add(&sums_after[1], steps_of(best.square, rules->square_step));
#endif
    atomic_inc(made);
}
