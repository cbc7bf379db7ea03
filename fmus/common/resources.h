/* The folder of an FMU's resources, and the files in it. */
#ifndef INKLOOP_RESOURCES_H
#define INKLOOP_RESOURCES_H

#include <stddef.h>

/* The path that a URI of FMI 2 names: "file:///a%20b/resources" is /a b/resources, "file:///C:/x" is C:/x and
 * "file://server/share" //server/share. Any other text is used as a path: some importers pass one. The caller frees it;
 * NULL if there is no memory or no URI. */
char *resource_path(const char *uri);

/* A copy, freed by the caller; NULL for NULL or if there is no memory. */
char *text_copy(const char *text);

/* The whole file `name` of a folder, freed by the caller; NULL, with the reason in `message`, if it cannot be read. */
unsigned char *read_resource(const char *folder, const char *name, size_t *size, char *message, size_t message_size);

#endif
