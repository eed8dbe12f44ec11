#include "scene.h"

#include <errno.h>
#include <stdarg.h>
#include <sys/mman.h>

struct scene *scene_new(void) {
    void *memory = mmap(NULL, sizeof(struct scene), PROT_READ | PROT_WRITE,
                        MAP_SHARED | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
    if (memory == MAP_FAILED)
        g_error("simulate: no memory for a simulated run: %s", g_strerror(errno));
    return memory;
}

void scene_free(struct scene *scene) {
    munmap(scene, sizeof *scene);
}

void scene_break(struct scene *scene, const char *invariant, const char *format, ...) {
    va_list args;
    va_start(args, format);
    g_autofree char *text = g_strdup_vprintf(format, args);
    va_end(args);
    disk_say(&scene->disk, "BROKEN %s: %s", invariant, text);
    g_autofree char *neutral = disk_neutral(&scene->disk, text);
    if (!*scene->violation)
        g_snprintf(scene->violation, sizeof scene->violation, "%s: %s", invariant, neutral);
}
