/* The search of a plan by moves that do not meet, for OpenCL: the layer map and the cost of a cell are those of
 * controller/core/search/plan_surface.h, to the last bit.
 *
 * Maps have a frame of one cell, as there. A move changes the plan on one cell or two. A group of work items tries all
 * moves of a cell in single precision, some at a time, on heights above the middle of a window; the best one is carried
 * through the layers again in double precision, and made if it pays. Cells of one launch lie so far apart that none
 * writes what another one reads. Sums are of whole numbers, so that their order is free. */
#pragma OPENCL EXTENSION cl_khr_fp64 : enable
#if DEVIATION
#pragma OPENCL EXTENSION cl_khr_int64_base_atomics : enable
#endif
#pragma OPENCL FP_CONTRACT OFF

/* LAYERS: horizon; KINDS: of droplets; CEILING, WEIGHT, DEVIATION: whether these count; GROUP: work items of a cell;
 * TEAM: those that try a move. */
#define TEAMS (GROUP / TEAM)
#define REACH (LAYERS + 2) /* cells from the middle of a window to its edge */
#define SIDE (2 * REACH + 1)
#define WINDOW (SIDE * SIDE)
#define MOVES (KINDS + LAYERS + 4) /* at most, of a cell: values, later layers, swaps */
#define IN_A_LAYER 1 /* sorts of moves: another value or a swap with a neighbour; a droplet in another layer */
#define BETWEEN_LAYERS 2
#define MIDDLE (REACH * SIDE + REACH)
#define BETWEEN (LAYERS > 1 ? LAYERS - 1 : 1) /* surfaces between two layers */
#define ABYSS -1.0
#define WAKE_REACH 3 /* cells from a change within which moves wake, of controller/core/search/tile_moves.c */

/* A droplet of a value of the plan, as in droplet_flow.h. */
typedef struct {
    double volume, spread[2], slope[2];
} Droplet;

/* The same for trials; rate: share of the spread that flows on or back for a metre of rise. */
typedef struct {
    float volume, spread[2], rate[2];
} TriedDroplet;

typedef struct {
    long nx, ny, stride, framed;
    double upward, skew, ceiling_cost, chance, least_chance;
    double alpha, count, reference, least_gain, least_trial;
    double height_step, square_step; /* steps of the sums [m], [m2] */
} Rules;

/* Cells whose moves of a sort are tried together: every `period` th of a layer from (ci, cj) on, `batch` by a group. */
typedef struct {
    int sort, layer, period, ci, cj, batch;
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

/* Cost of a cell, and the volume of its last droplet that is left to chance. */
#define COST(real, cost_of, chance_of)                                                                                 \
    real cost_of(constant Rules *rules, real weight, real target, real ceiling, real height, real chance) {            \
        const real error = height - target, size = fabs(error);                                                        \
        const real expected = size < chance ? (real)0.5 * (error * error / chance + chance) : size;                    \
        real cost = (real)rules->upward * expected + (real)rules->skew * error;                                        \
        if (CEILING && height > ceiling)                                                                               \
            cost += (real)rules->ceiling_cost * (height - ceiling);                                                    \
        return weight * cost;                                                                                          \
    }                                                                                                                  \
    real chance_of(constant Rules *rules, real kept) {                                                                 \
        const real own = (real)rules->chance * kept;                                                                   \
        return own > (real)rules->least_chance ? own : (real)rules->least_chance;                                      \
    }
COST(double, cost_of, chance_of)
COST(float, tried_cost, tried_chance)

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

/* Puts the first surface onto the lattice, multiples of 2^-54 m. Work items: (ny, nx), as of `print_layer`. */
kernel void take_height(constant Rules *rules, global double *height) {
    const long cell = (get_global_id(1) + 1) * rules->stride + get_global_id(0) + 1;
    height[cell] = rint(height[cell] * 0x1p54) * 0x1p-54;
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

/* Change of the standard deviation by a move (objective.c). Where other cells share the launch, the change on the
 * tangent: the deviation is concave in the sums, so what their moves change together is not above the sum of these. */
double deviation_change(constant Rules *rules, global const long *sums, bool is_shared, double height, double square) {
    const double count = rules->count, mean = sums[0] * rules->height_step / count;
    const double before = fmax(sums[1] * rules->square_step / count - mean * mean, 0.0);
    const double change =
        (square - 2.0 * mean * height) / count - (is_shared ? 0.0 : height * height / (count * count));
    const double after = is_shared && before > 0.0 ? before : fmax(before + change, 0.0);
    const double deviations = sqrt(before) + sqrt(after);
    return deviations > 0.0 ? change / deviations : 0.0;
}
#endif

bool allows(global const ushort *choices, constant Rules *rules, int layer, long cell, int value) {
    return (2u * choices[layer * rules->framed + cell] + 1u) >> value & 1u;
}

/* Sums of a move. */
typedef struct {
    double change, height, square;
} Gain;

/* What a group of work items knows to carry a move. */
typedef struct {
    double surface[LAYERS + 1][WINDOW], chance[WINDOW], sum[3][GROUP];
    uchar value[LAYERS][WINDOW];
} Window;

/* What it knows to try some at a time; heights are above that of the middle before the layer. */
typedef struct {
    TriedDroplet droplet[KINDS + 1];
    float height[LAYERS][WINDOW];                         /* before each layer */
    float before[WINDOW], target[WINDOW], weight[WINDOW]; /* before: cost of the plan */
    float ceiling[CEILING ? WINDOW : 1], last[DEVIATION ? WINDOW : 1], left[DEVIATION ? WINDOW : 1];
    float between[TEAMS][BETWEEN][WINDOW];     /* of a move: before each later layer */
    float sum[3][GROUP], change[MOVES], above; /* above: twice the middle above the reference */
    uchar value[TEAMS][LAYERS][WINDOW];        /* of the plan with a move */
    uchar is_allowed[MOVES], number[MOVES];
} Trials;

typedef union {
    Trials trials;
    Window window;
} Shared;

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
    bool is_shared; /* whether the launch has other cells */
} Maps;

/* Cells from the middle where a surface differs after a layer. */
int reach_of(const Move *move, int layer) {
    return layer - move->layer + 1 + (move->is_two && move->here != move->there);
}

/* Loads the plan with the move, and the surfaces that it meets. */
void load(const Maps *maps, const Move *move, long i, long j, local Window *window) {
    constant Rules *rules = maps->rules;
    for (int q = get_local_id(0); q < WINDOW; q += GROUP) {
        const int di = q / SIDE - REACH, dj = q % SIDE - REACH, far = max(abs(di), abs(dj));
        const long row = i + 1 + di, column = j + 1 + dj, cell = row * rules->stride + column;
        const bool is_there = row >= 0 && row <= rules->nx + 1 && column >= 0 && column <= rules->ny + 1;
        for (int layer = move->layer; layer < LAYERS; layer++) {
            if (far > reach_of(move, layer) + 1)
                continue;
            window->surface[layer][q] = is_there ? maps->height[layer * rules->framed + cell] : ABYSS;
            int value = is_there ? maps->plan[layer * rules->framed + cell] : 0;
            if (layer == move->layer && cell == move->here)
                value = move->is;
            else if (move->is_two && layer == move->its_layer && cell == move->there)
                value = move->its_is;
            window->value[layer][q] = value;
        }
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
            const double weight = WEIGHT ? maps->weight[cell] : maps->part[cell];
            costs += cost_of(rules, weight, target, limit, after, chance) -
                     cost_of(rules, weight, target, limit, before, left);
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
    for (int rest = move->layer < LAYERS ? GROUP / 2 : 0; rest > 0; rest /= 2) {
        barrier(CLK_LOCAL_MEM_FENCE);
        for (int k = 0; item < rest && k < 3; k++)
            window->sum[k][item] += window->sum[k][item + rest];
    }
    barrier(CLK_LOCAL_MEM_FENCE);
    Gain gain = {window->sum[0][0] / rules->count, window->sum[1][0], window->sum[2][0]};
#if DEVIATION
    gain.change = rules->alpha * gain.change +
                  (1.0 - rules->alpha) * deviation_change(rules, maps->sums, maps->is_shared, gain.height, gain.square);
#endif
    barrier(CLK_LOCAL_MEM_FENCE);
    return gain;
}

/* Makes a move that has been carried, and wakes the moves near it. */
void make(const Maps *maps, const Move *move, long i, long j, local const Window *window, global uchar *awake) {
    constant Rules *rules = maps->rules;
    const int changed = reach_of(move, LAYERS - 1);
    for (int q = get_local_id(0); q < WINDOW; q += GROUP) {
        const long cell = cell_of(rules, i, j, q);
        if (!is_within(rules, i, j, q, changed))
            continue;
        for (int layer = move->layer; layer < LAYERS; layer++)
            if (is_within(rules, i, j, q, reach_of(move, layer)))
                maps->height[(layer + 1) * rules->framed + cell] = window->surface[layer + 1][q];
        maps->chance[cell] = window->chance[q];
    }
    const int far = WAKE_REACH + (move->is_two && move->here != move->there);
    const long top = max(i - far, 0l), bottom = min(i + far, rules->nx - 1);
    const long left = max(j - far, 0l), width = min(j + far, rules->ny - 1) - left + 1;
    for (long place = get_local_id(0); place < (bottom - top + 1) * width; place += GROUP)
        for (int layer = 0; layer < LAYERS; layer++)
            awake[layer * rules->framed + (top + place / width + 1) * rules->stride + left + place % width + 1] =
                IN_A_LAYER | BETWEEN_LAYERS;
    if (get_local_id(0) > 0)
        return;
    maps->plan[move->layer * rules->framed + move->here] = move->is;
    if (move->is_two)
        maps->plan[move->its_layer * rules->framed + move->there] = move->its_is;
}

/* Move number `number` of a cell: another value, its droplet in a later layer, or that of a neighbour; each pair of
 * neighbours is a move of one of them. False: none. */
bool move_of(const Maps *maps, int layer, long i, long j, int number, Move *move) {
    constant Rules *rules = maps->rules;
    const int later = number - KINDS, swap = later - (LAYERS - layer),
              its_layer = swap < 0 && later > 0 ? layer + later : layer;
    const long k = i + (swap > 0), l = j + (swap < 0 ? 0 : swap == 0 ? 1 : swap - 2);
    if (swap > 3 || k >= rules->nx || l < 0 || l >= rules->ny)
        return false;
    const long here = (i + 1) * rules->stride + j + 1, there = (k + 1) * rules->stride + l + 1;
    const int was = maps->plan[layer * rules->framed + here], its = maps->plan[its_layer * rules->framed + there];
    *move = (Move){layer, its_layer, later > 0 ? its : number, was, here, there, later > 0};
    return move->is != was && allows(maps->choices, rules, layer, here, move->is) &&
           (later <= 0 || allows(maps->choices, rules, its_layer, there, was));
}

/* Sort of move number `number`. */
int sort_of(int layer, int number) {
    return number > KINDS && number < KINDS + LAYERS - layer ? BETWEEN_LAYERS : IN_A_LAYER;
}

/* Loads what moves of a sort on a cell need. */
void load_trials(const Maps *maps, constant TriedDroplet *droplets, int layer, long i, long j, int sort,
                 local Trials *trials) {
    constant Rules *rules = maps->rules;
    const int apart = sort == IN_A_LAYER; /* a swap reaches a cell further than its layers */
    const double middle = maps->height[layer * rules->framed + (i + 1) * rules->stride + j + 1];
    for (int q = get_local_id(0); q <= KINDS; q += GROUP)
        trials->droplet[q] = droplets[q];
    if (get_local_id(0) == 0)
        trials->above = 2.0 * (middle - rules->reference);
    for (int m = layer; m < LAYERS; m++) {
        const int far = m - layer + 2 + apart, side = 2 * far + 1;
        for (int place = get_local_id(0); place < side * side; place += GROUP) {
            const int di = place / side - far, dj = place % side - far, q = (di + REACH) * SIDE + dj + REACH;
            const long row = i + 1 + di, column = j + 1 + dj, cell = m * rules->framed + row * rules->stride + column;
            const bool is_there = row >= 0 && row <= rules->nx + 1 && column >= 0 && column <= rules->ny + 1;
            const float height = is_there ? maps->height[cell] - middle : ABYSS;
            const uchar value = is_there ? maps->plan[cell] : 0;
            trials->height[m][q] = height;
            for (int team = 0; team < TEAMS; team++) {
                trials->value[team][m][q] = value;
                if (m > layer)
                    trials->between[team][m - 1][q] = height;
            }
        }
    }
    const int far = LAYERS - layer + apart, side = 2 * far + 1;
    for (int place = get_local_id(0); place < side * side; place += GROUP) {
        const int q = (place / side - far + REACH) * SIDE + place % side - far + REACH;
        const long cell = cell_of(rules, i, j, q);
        if (!is_within(rules, i, j, q, far))
            continue;
        const float last = maps->height[LAYERS * rules->framed + cell] - middle, left = maps->chance[cell];
        const float target = maps->target[cell] - middle, ceiling = CEILING ? maps->ceiling[cell] - middle : 0.0;
        const float weight = WEIGHT ? maps->weight[cell] : maps->part[cell];
        trials->target[q] = target;
        trials->weight[q] = weight;
        trials->before[q] = tried_cost(rules, weight, target, ceiling, last, left);
#if CEILING
        trials->ceiling[q] = ceiling;
#endif
#if DEVIATION
        trials->last[q] = last;
        trials->left[q] = left;
#endif
    }
}

#if KINDS == 1
#define VOLUME(is) ((is) ? droplet[1].volume : 0.0f)
#define SPREAD(is, place) ((is) ? droplet[1].spread[place] : 0.0f)
#define RATE(is, place) droplet[1].rate[place]
#else
#define VOLUME(is) droplet[is].volume
#define SPREAD(is, place) droplet[is].spread[place]
#define RATE(is, place) droplet[is].rate[place]
#endif

/* Height of a cell of a window after a layer, and what its own droplet leaves on it. */
float tried_height(local const TriedDroplet *droplet, local const float *height, local const uchar *value, int q,
                   float *kept) {
    const float own = height[q];
    const int is = value[q];
    float lost[2] = {0.0f, 0.0f}, got = 0.0f;
#pragma unroll
    for (int di = -1; di <= 1; di++)
#pragma unroll
        for (int dj = -1; dj <= 1; dj++) {
            const int place = di != 0 && dj != 0, its = value[q + di * SIDE + dj];
            const float rise = own - height[q + di * SIDE + dj];
            if (di == 0 && dj == 0)
                continue;
            lost[place] += clamp(fma(RATE(is, place), rise, 1.0f), 0.0f, 1.0f);
            got = fma(SPREAD(its, place), clamp(fma(RATE(its, place), -rise, 1.0f), 0.0f, 1.0f), got);
        }
    *kept = VOLUME(is) - (SPREAD(is, 0) * lost[0] + SPREAD(is, 1) * lost[1]);
    return own + *kept + got;
}

/* Writes a move into the plan of a team, or takes it out again. */
void set_values(const Move *move, local Trials *trials, int team, int is, int its_is, int there) {
    trials->value[team][move->layer][MIDDLE] = is;
    if (move->is_two)
        trials->value[team][move->its_layer][there] = its_is;
}

/* The cells that a move changes: those within `far` of the one, and of the other, which lies so far down and along. */
typedef struct {
    int top, left, width, cells;
} Box;

Box box_of(int far, int down, int along) {
    const int width = 2 * far + 1 + abs(along);
    return (Box){-far, -far + min(along, 0), width, (2 * far + 1 + down) * width};
}

/* The place in the window, and the cells from its middle. */
int in_box(const Box *box, int place, int *di, int *dj) {
    *di = place / box->width + box->top;
    *dj = place % box->width + box->left;
    return (*di + REACH) * SIDE + *dj + REACH;
}

/* Tries all moves of a sort that are allowed on a cell, a team each; their number, and what each changes. */
int try_all(const Maps *maps, int layer, long i, long j, int sort, local Trials *trials) {
    constant Rules *rules = maps->rules;
    const int item = get_local_id(0), team = item / TEAM, mate = item % TEAM;
    int count = 0, di, dj;
    Move move;
    if (item < MOVES)
        trials->is_allowed[item] = sort_of(layer, item) == sort && move_of(maps, layer, i, j, item, &move);
    barrier(CLK_LOCAL_MEM_FENCE);
    for (int number = 0; number < MOVES; number++) {
        if (item == 0 && trials->is_allowed[number])
            trials->number[count] = number;
        count += trials->is_allowed[number];
    }
    barrier(CLK_LOCAL_MEM_FENCE);
    for (int first = 0; first < count; first += TEAMS) {
        const int own = first + team;
        const bool is_busy = own < count && move_of(maps, layer, i, j, trials->number[own], &move);
        const int apart = is_busy ? move.there - move.here : 0;
        const int down = (apart + 1) / rules->stride, along = apart - down * rules->stride;
        const int there = MIDDLE + down * SIDE + along;
        float costs = 0.0f, heights = 0.0f, squares = 0.0f;
        if (is_busy && mate == 0)
            set_values(&move, trials, team, move.is, move.its_is, there);
        barrier(CLK_LOCAL_MEM_FENCE);
        for (int m = layer; m < LAYERS; m++) {
            const Box box = box_of(m - layer + 1, down, along);
            local const float *height = m == layer ? trials->height[m] : trials->between[team][m - 1];
            for (int place = mate; is_busy && place < box.cells; place += TEAM) {
                const int q = in_box(&box, place, &di, &dj);
                float kept;
                if (i + di < 0 || i + di >= rules->nx || j + dj < 0 || j + dj >= rules->ny)
                    continue;
                const float after = tried_height(trials->droplet, height, trials->value[team][m], q, &kept);
                if (m < LAYERS - 1) {
                    trials->between[team][m][q] = after;
                    continue;
                }
                const float chance = rules->chance > 0.0 ? tried_chance(rules, kept) : 0.0f;
                costs += tried_cost(rules, trials->weight[q], trials->target[q], CEILING ? trials->ceiling[q] : 0.0f,
                                    after, chance) -
                         trials->before[q];
#if DEVIATION
                if (maps->part[cell_of(rules, i, j, q)]) {
                    const float before = trials->last[q], left = trials->left[q];
                    heights += after - before;
                    squares +=
                        (after - before) * (after + before + trials->above) + (chance * chance - left * left) / 3.0f;
                }
#endif
            }
            barrier(CLK_LOCAL_MEM_FENCE);
        }
        if (is_busy && mate == 0)
            set_values(&move, trials, team, move.its_is, move.is, there);
        for (int m = layer; m < LAYERS - 1; m++) {
            const Box box = box_of(m - layer + 1, down, along);
            for (int place = mate; is_busy && place < box.cells; place += TEAM) {
                const int q = in_box(&box, place, &di, &dj);
                trials->between[team][m][q] = trials->height[m + 1][q];
            }
        }
        trials->sum[0][item] = costs;
        trials->sum[1][item] = heights;
        trials->sum[2][item] = squares;
        for (int rest = TEAM / 2; rest > 0; rest /= 2) {
            barrier(CLK_LOCAL_MEM_FENCE);
            for (int k = 0; mate < rest && k < (DEVIATION ? 3 : 1); k++)
                trials->sum[k][item] += trials->sum[k][item + rest];
        }
        if (is_busy && mate == 0) {
            double change = trials->sum[0][item] / rules->count;
#if DEVIATION
            change = rules->alpha * change + (1.0 - rules->alpha) * deviation_change(rules, maps->sums, maps->is_shared,
                                                                                     trials->sum[1][item],
                                                                                     trials->sum[2][item]);
#endif
            trials->change[own] = change;
        }
    }
    barrier(CLK_LOCAL_MEM_FENCE);
    return count;
}

/* Makes the best move of a cell, if it pays; whether it did, and what that changes. */
bool try_cell(const Maps *maps, constant TriedDroplet *tried, int layer, long i, long j, int sort, local Shared *shared,
              global uchar *awake, Gain *gain) {
    constant Rules *rules = maps->rules;
    float least = -rules->least_trial;
    int chosen = -1;
    Move move;
    barrier(CLK_LOCAL_MEM_FENCE);
    load_trials(maps, tried, layer, i, j, sort, &shared->trials);
    const int count = try_all(maps, layer, i, j, sort, &shared->trials);
    for (int k = 0; k < count; k++)
        if (shared->trials.change[k] < least) {
            least = shared->trials.change[k];
            chosen = shared->trials.number[k];
        }
    barrier(CLK_LOCAL_MEM_FENCE);
    if (chosen < 0 || !move_of(maps, layer, i, j, chosen, &move))
        move = (Move){.layer = LAYERS}; /* nothing to carry: all items meet all barriers */
    *gain = carry(maps, &move, i, j, &shared->window);
    const bool is_made = gain->change < -rules->least_gain;
    if (is_made)
        make(maps, &move, i, j, &shared->window, awake);
    return is_made;
}

/* Tries the moves of a launch. awake: sorts of moves, of each cell in each layer, near which something has changed
 * since they were tried; sums: those before the launch; sums_after: they are changed; made: counts the moves. */
kernel __attribute__((reqd_work_group_size(GROUP, 1, 1))) void
try_moves(constant Rules *rules, constant Droplet *droplets, constant TriedDroplet *tried,
          global const Launch *launches, int number, global double *height, global uchar *plan, global double *chance,
          global const double *target, global const double *weight, global const double *ceiling,
          global const uchar *part, global const ushort *choices, global uchar *awake, global const long *sums,
          global long *sums_after, global int *made) {
    local Shared shared;
    local uchar is_awake[GROUP];
    global const Launch *launch = &launches[number];
    const int layer = launch->layer, sort = launch->sort, batch = launch->batch, item = get_local_id(0);
    const long columns = (rules->ny - launch->cj + launch->period - 1) / launch->period;
    const long rows = (rules->nx - launch->ci + launch->period - 1) / launch->period;
    const Maps maps = {rules,  droplets, height, chance,  plan, target,
                       weight, ceiling,  part,   choices, sums, rows * columns > 1};
    const long first = get_group_id(0) * batch, own = first + item;
    global uchar *sorts = &awake[layer * rules->framed];
    sorts += (own / columns * launch->period + launch->ci + 1) * rules->stride;
    sorts += own % columns * launch->period + launch->cj + 1;
    is_awake[item] = item < batch && own < rows * columns && *sorts & sort;
    if (is_awake[item])
        *sorts &= ~sort;
    barrier(CLK_LOCAL_MEM_FENCE | CLK_GLOBAL_MEM_FENCE);
    long next = first, count = 0;
    for (int k = 0; k < batch; k++)
        count += is_awake[k];
    for (; count > 0; count--, next++) {
        while (!is_awake[next - first])
            next++;
        const long i = next / columns * launch->period + launch->ci;
        const long j = next % columns * launch->period + launch->cj;
        Gain gain;
        const bool is_made = try_cell(&maps, tried, layer, i, j, sort, &shared, awake, &gain);
        if (is_made && item == 0) {
#if DEVIATION
            atom_add(&sums_after[0], steps_of(gain.height, rules->height_step));
            atom_add(&sums_after[1], steps_of(gain.square, rules->square_step));
#endif
            atomic_inc(made);
        }
    }
}
