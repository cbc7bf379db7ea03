/* The life of an instance, from its creation over initialisation and steps to its release. */
#ifndef INKLOOP_LIFECYCLE_H
#define INKLOOP_LIFECYCLE_H

#include "storage.h"

/* The model that an FMU offers; its kernel may use further models as parts. */
extern const Model *const FMU_MODEL;

/* The token is "Model-fingerprint-NXxNY", or "...-NXxNYxDEPTH" (storage.h), with "-resizable" at the end where these
 * can be set, or a mark of the model's resources (see fmu_writer/definition.py); `resources` is the path of their
 * folder or NULL. NULL on failure, with the reason in `message`. */
Instance *instance_create(const Model *model, const char *token, bool has_scalar_references, const char *resources,
                          char message[MESSAGE_SIZE]);
void instance_free(Instance *instance);

/* Resets everything to the state of a new instance. */
Outcome instance_reset(Instance *instance);

Outcome instance_enter_configuration(Instance *instance);
Outcome instance_exit_configuration(Instance *instance);
Outcome instance_enter_initialization(Instance *instance, double start_time);
Outcome instance_exit_initialization(Instance *instance);
Outcome instance_do_step(Instance *instance, double start, double step);
double instance_time(Instance *instance);

/* MISUSED if one of the log categories is not one that the model descriptions name. */
Outcome check_categories(Instance *instance, size_t count, const char *const categories[]);

#endif
