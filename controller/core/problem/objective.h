/* Objective of a layer (Lu, Zheng, Mishra 2015, eq. 8): alpha * mean |target - H| + (1 - alpha) * std(H) over the part,
 * from running sums, so that a trial costs only the cells it touches. */
#ifndef INKLOOP_OBJECTIVE_H
#define INKLOOP_OBJECTIVE_H

/* Sums over the cells, or their change by a trial. The height counts from a reference near its mean: its square would
 * cancel against the squared mean if it counted from the substrate. */
typedef struct {
    double cost;           /* sum of weighted errors and of heights above the ceiling [m] */
    double height;         /* sum over the part [m] */
    double squared_height; /* sum over the part [m2] */
} Sums;

typedef struct {
    double alpha; /* weight of the mean error, 0 to 1 */
    double count; /* cells of the part, > 0 */
} Weighting;

/* The objective [m]. */
double objective(const Sums *sums, const Weighting *weighting);

/* Standard deviation of the heights [m]. */
double deviation(const Sums *sums, const Weighting *weighting);

/* Change of the objective by `change` [m]; exact to rounding of the change itself, however large the sums are. */
double objective_change(const Sums *sums, const Sums *change, const Weighting *weighting);

/* sums + change */
static inline Sums sums_after(const Sums *sums, const Sums *change) {
    return (Sums){sums->cost + change->cost, sums->height + change->height,
                  sums->squared_height + change->squared_height};
}

#endif
