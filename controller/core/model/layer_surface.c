#include "layer_surface.h"

#include "row_ranges.h"

typedef struct {
    DropletPass pass;
    double *after;
} Deposit;

static void deposit_range(void *context, const RowRange *range) {
    const Deposit *deposit = context;
    deposit_rows(&deposit->pass, range->top, range->bottom, deposit->after);
}

double layer_surface(const JettedLayer *layer, const double *height, const Ink ink[2], double *scratch, double *after) {
    Deposit deposit = {{layer->nx, layer->ny, height, layer->pattern, {ink[0], ink[1]}, layer->factor, COLOUR_ALL},
                       NULL};
    double lost = 0.0;
    for (int32_t pass = 0; pass < layer->passes; pass++) {
        deposit.after = (layer->passes - pass) % 2 == 0 ? scratch : after; /* the last one is `after` */
        if (layer->passes > 1)
            deposit.pass.colour = layer->order[pass];
        run_rows(layer->threads, layer->nx, layer->ny, deposit_range, &deposit);
        lost += lost_in_pass(&deposit.pass);
        deposit.pass.before = deposit.after;
    }
    return lost;
}
