#include "liquid_body.h"

#include "banded_cholesky.h"

#include <math.h>
#include <string.h>

/* steps of the iteration; nodes may be released from the solid in the first of them only */
enum { STEPS = 60, FREE_STEPS = 30 };
/* longest last Newton step, in spacings: the next one would be about its square */
static const double SMALL = 2e-3;
static const double OVERSHOOT = 0.5;    /* slope at the end of a step over the slope at its begin */
static const double WALL = 0.25;        /* height, in radii of the liquid's curvature (assumed) */
static const double WALL_SHARE = 0.125; /* of the edge (assumed) */
static const double SHORTEST = 1e-3;    /* smallest share of a step */

/* Slope of the liquid along an arm, outwards. */
static double slope(const LiquidBody *body, const WettedNode *node, double depth, int arm) {
    const double far = node->next[arm] < 0 ? 0.0 : body->depth[node->next[arm]];
    return node->rise[arm] + (far - depth) / node->arm[arm];
}

/* Length of an arm that belongs to its node: half, or all of it if it ends on the edge. */
static double extent(const WettedNode *node, int arm) {
    return node->next[arm] < 0 ? node->arm[arm] : 0.5 * node->arm[arm];
}

/* One arm of the node at hand. */
typedef struct {
    int32_t next;
    double inverse, weight, slope; /* inverse of its length; weight of its half in a flux; slope of the liquid */
} Arm;

/* Contribution of a quarter of a square: its fluxes along both arms, and their derivatives by the slopes. */
typedef struct {
    double x, y, xx, xy, yy;
} Fluxes;

/* Fluxes of a quarter. If one arm is cut, the weights differ, and the derivative of one flux by the other slope would
 * not be symmetric: with the mean of both Newton's method still converges. */
static Fluxes fluxes(SurfaceForm form, const Arm *x, const Arm *y) {
    if (form == LINEAR)
        return (Fluxes){x->weight * x->slope, y->weight * y->slope, x->weight, 0.0, y->weight};
    const double xx = x->slope * x->slope, yy = y->slope * y->slope;
    const double shrink = 1.0 / sqrt(1.0 + xx + yy), cubed = shrink * shrink * shrink;
    const double both = x->weight == y->weight ? x->weight : sqrt(x->weight * y->weight);
    return (Fluxes){x->weight * x->slope * shrink, y->weight * y->slope * shrink, x->weight * cubed * (1.0 + yy),
                    -both * cubed * x->slope * y->slope, y->weight * cubed * (1.0 + xx)};
}

static double *element(LiquidBody *body, size_t one, size_t other) {
    const size_t low = one < other ? one : other, high = one < other ? other : one;
    return &body->matrix[low * (body->wet.bandwidth + 1) + high - low];
}

static void add_quarter(LiquidBody *body, SurfaceForm form, size_t k, const Arm *x, const Arm *y) {
    const Fluxes f = fluxes(form, x, y);
    const double along_x = f.xx * x->inverse + f.xy * y->inverse, along_y = f.yy * y->inverse + f.xy * x->inverse;
    body->force[k] -= f.x * x->inverse + f.y * y->inverse;
    *element(body, k, k) += along_x * x->inverse + along_y * y->inverse;
    if (x->next >= 0) {
        const size_t next = (size_t)x->next;
        body->force[next] += f.x * x->inverse;
        *element(body, next, next) += f.xx * x->inverse * x->inverse;
        *element(body, k, next) -= along_x * x->inverse;
    }
    if (y->next >= 0) {
        const size_t next = (size_t)y->next;
        body->force[next] += f.y * y->inverse;
        *element(body, next, next) += f.yy * y->inverse * y->inverse;
        *element(body, k, next) -= along_y * y->inverse;
    }
    if (x->next >= 0 && y->next >= 0)
        *element(body, (size_t)x->next, (size_t)y->next) += f.xy * x->inverse * y->inverse;
}

static void assemble(LiquidBody *body, SurfaceForm form) {
    const size_t count = body->wet.count;
    memset(body->force, 0, count * sizeof *body->force);
    memset(body->matrix, 0, count * (body->wet.bandwidth + 1) * sizeof *body->matrix);
    for (size_t k = 0; k < count; k++) {
        const WettedNode *node = &body->wet.nodes[k];
        Arm arms[ARMS];
        for (int arm = 0; arm < ARMS; arm++)
            arms[arm] = (Arm){node->next[arm], 1.0 / node->arm[arm], 0.5 * extent(node, arm),
                              slope(body, node, body->depth[k], arm)};
        for (int x = LEFT; x <= RIGHT; x++)
            for (int y = DOWN; y <= UP; y++)
                add_quarter(body, form, k, &arms[x], &arms[y]);
    }
}

/* Releases nodes that the liquid pulls off the solid; returns their number. */
static size_t release(LiquidBody *body) {
    size_t released = 0;
    for (size_t k = 0; k < body->wet.count; k++) {
        if (body->is_pinned[k] && body->force[k] < body->pressure) {
            body->is_pinned[k] = false;
            released++;
        }
    }
    return released;
}

/* Pins nodes that a step has moved below the solid; returns their number. */
static size_t pin(LiquidBody *body) {
    size_t pinned = 0;
    for (size_t k = 0; k < body->wet.count; k++) {
        if (body->depth[k] < 0.0) {
            body->depth[k] = 0.0;
            body->is_pinned[k] = true;
            pinned++;
        }
    }
    return pinned;
}

static void cut_off_pinned(LiquidBody *body) {
    const size_t bandwidth = body->wet.bandwidth, stride = bandwidth + 1;
    for (size_t k = 0; k < body->wet.count; k++) {
        if (!body->is_pinned[k])
            continue;
        for (size_t j = 1; j <= bandwidth && j <= k; j++)
            body->matrix[(k - j) * stride + j] = 0.0;
        memset(body->matrix + k * stride, 0, stride * sizeof *body->matrix);
        body->matrix[k * stride] = 1.0;
    }
}

/* The Newton step to equilibrium at the given volume, in `step`; false if there is none. */
static bool find_step(LiquidBody *body, double volume) {
    const size_t count = body->wet.count, bandwidth = body->wet.bandwidth;
    cut_off_pinned(body);
    double missing = volume;
    for (size_t k = 0; k < count; k++) {
        body->step[k] = body->is_pinned[k] ? 0.0 : -body->force[k];
        body->response[k] = body->is_pinned[k] ? 0.0 : 1.0;
        missing -= body->depth[k];
    }
    if (!band_factor(body->matrix, count, bandwidth))
        return false;
    band_solve(body->matrix, count, bandwidth, body->step, body->response);
    double all_responses = 0.0;
    for (size_t k = 0; k < count; k++) {
        missing -= body->step[k];
        all_responses += body->response[k];
    }
    body->pressure = missing / all_responses;
    for (size_t k = 0; k < count; k++)
        body->step[k] += body->pressure * body->response[k];
    return all_responses > 0.0 && isfinite(body->pressure);
}

/* Slope of the energy along the last step, without the work of the pressure, at the present depths. */
static double slope_along_step(const LiquidBody *body) {
    double sum = 0.0;
    for (size_t k = 0; k < body->wet.count; k++)
        if (!body->is_pinned[k])
            sum += (body->force[k] - body->pressure) * body->step[k];
    return sum;
}

/* Moves by a share of the step, and undoes pins of a longer share: nodes that were pinned before have no step. */
static void move(LiquidBody *body, double share) {
    for (size_t k = 0; k < body->wet.count; k++) {
        body->depth[k] = body->previous[k] + share * body->step[k];
        body->is_pinned[k] = body->is_pinned[k] && body->step[k] == 0.0;
    }
}

static bool has_pinned(const LiquidBody *body) {
    for (size_t k = 0; k < body->wet.count; k++)
        if (body->is_pinned[k])
            return true;
    return false;
}

/* Takes the share of the step that does not overshoot the lowest energy along it; returns the number of nodes pinned. A
 * linear body that touches the solid nowhere is solved, and its forces are not used. */
static size_t take_step(LiquidBody *body, SurfaceForm form) {
    const double begin = slope_along_step(body);
    memcpy(body->previous, body->depth, body->wet.count * sizeof *body->depth);
    for (double share = 1.0;; share *= 0.5) {
        move(body, share);
        const size_t pinned = pin(body);
        if (form == LINEAR && !has_pinned(body))
            return 0;
        assemble(body, form);
        if (form == LINEAR || share < SHORTEST || slope_along_step(body) <= OVERSHOOT * fabs(begin))
            return pinned;
    }
}

static double largest(const double *values, size_t count) {
    double found = 0.0;
    for (size_t k = 0; k < count; k++)
        found = fmax(found, fabs(values[k]));
    return found;
}

/* Iterates from the present depths to equilibrium. A nonlinear body without equilibrium would pin all nodes but one and
 * collect its volume there: it gets only the steps in which nodes may be released from the solid. */
static bool iterate(LiquidBody *body, SurfaceForm form, double volume) {
    const int steps = form == LINEAR ? STEPS : FREE_STEPS;
    assemble(body, form);
    size_t changed = 0;
    for (int step = 0; step < steps; step++) {
        if (!find_step(body, volume))
            return false;
        changed = take_step(body, form);
        if (step < FREE_STEPS)
            changed += release(body);
        if (changed == 0 && (form == LINEAR || largest(body->step, body->wet.count) < SMALL))
            return true;
    }
    return form == LINEAR;
}

/* Scales the depths to the exact volume: rounding, and nodes pinned in the last step, change it. */
static bool scale_to(LiquidBody *body, double volume) {
    double sum = 0.0;
    for (size_t k = 0; k < body->wet.count; k++)
        sum += body->depth[k];
    for (size_t k = 0; k < body->wet.count; k++)
        body->depth[k] *= volume / sum;
    return sum > 0.0;
}

/* Sine of the liquid's inclination along an arm, upwards from the node to the next one. */
static double rise_of(const LiquidBody *body, const WettedNode *node, size_t k, int arm) {
    const double along = slope(body, node, body->depth[k], arm);
    return along / sqrt(1.0 + along * along);
}

/* Fall over `length` of a surface with the constant curvature `bend`, beginning with the sine `begin`. Beyond the point
 * where it is upright it falls no further. */
static double fall_of(double begin, double bend, double length) {
    begin = fmin(begin, 1.0);
    const double end = fmin(begin + bend * length, 1.0);
    return bend > 1e-6 ? (sqrt(1.0 - begin * begin) - sqrt(1.0 - end * end)) / bend
                       : length * begin / sqrt(1.0 - begin * begin);
}

/* Height of the wall between the liquid and the edge at the end of an arm, in spacings: the height left if the bend of
 * the surface at the next two nodes continues to the edge. Half a spacing of it lies before the node. */
static double wall_at(const LiquidBody *body, size_t k, int arm) {
    const WettedNode *node = &body->wet.nodes[k];
    const int inward = arm ^ 1;
    const int32_t next = node->next[inward];
    if (next < 0 || body->wet.nodes[next].next[inward] < 0)
        return 0.0;
    const double near = rise_of(body, node, k, inward);
    const double bend = near - rise_of(body, &body->wet.nodes[next], (size_t)next, inward);
    const double at_node = near + 0.5 * bend;
    const double fall = -slope(body, node, body->depth[k], arm) * node->arm[arm];
    return at_node > 0.0 ? fall - fall_of(at_node, bend, node->arm[arm]) : 0.0;
}

/* Whether a body has no solution: where the surface would have to overhang, the least area is a wall along the edge.
 * Its height depends on the body and not on the distance of the nodes. Ends of lines may have walls over a few
 * points. */
static bool is_overhanging(const LiquidBody *body) {
    size_t edge = 0, walls = 0;
    for (size_t k = 0; k < body->wet.count; k++) {
        for (int arm = 0; arm < ARMS; arm++) {
            const bool is_edge = body->wet.nodes[k].next[arm] < 0;
            edge += is_edge;
            walls += is_edge && wall_at(body, k, arm) * body->pressure > WALL;
        }
    }
    return (double)walls > WALL_SHARE * (double)edge;
}

bool settle(LiquidBody *body, SurfaceForm form, double volume) {
    memset(body->depth, 0, body->wet.count * sizeof *body->depth);
    memset(body->is_pinned, 0, body->wet.count * sizeof *body->is_pinned);
    bool is_found = iterate(body, LINEAR, volume);
    if (is_found && form == NONLINEAR)
        is_found = iterate(body, NONLINEAR, volume) && !is_overhanging(body);
    return is_found && scale_to(body, volume);
}
