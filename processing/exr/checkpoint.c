/* Arrays are saved bit for bit as EXR parts whose pixels carry four bytes each. A hash of the
 * inputs decides whether a file belongs to the computation. A hash of each array detects damage. */
#include "checkpoint.h"

#include <gio/gio.h>
#include <glib/gstdio.h>
#include <string.h>
#include <xxhash.h>

#include "exr.h"

#include "base/error_details.h"

#define PERIOD_US (20 * G_USEC_PER_SEC)
#define HEAD      "checkpoint"
#define WORD      sizeof(float)
#define WIDTH     4096 /* number of pixels in a line of an array's part */
/* A save is due only when SHARE times the duration of the last save have passed since that save
 * ended. */
#define SHARE 20

struct array {
    char *name;
    gconstpointer values; /* borrowed; NULL if the array consists of flags */
    const int *flags;
    gsize size; /* bytes */
};

struct Checkpoint {
    char *path, *inputs, *note;
    GPtrArray *kept;   /* of struct array: the arrays to be saved */
    GHashTable *found; /* arrays of the file: name → GBytes */
    gint64 period_us, saved_us, took_us;
    gboolean own; /* whether the existing file belongs to this computation */
};

static void free_array(gpointer data) {
    struct array *array = data;
    g_free(array->name);
    g_free(array);
}

Checkpoint *checkpoint_new(const char *path) {
    Checkpoint *checkpoint = g_new0(Checkpoint, 1);
    checkpoint->path = g_strdup(path);
    checkpoint->kept = g_ptr_array_new_with_free_func(free_array);
    checkpoint->found =
        g_hash_table_new_full(g_str_hash, g_str_equal, g_free, (GDestroyNotify)g_bytes_unref);
    checkpoint->period_us = PERIOD_US;
    return checkpoint;
}

void checkpoint_free(Checkpoint *checkpoint) {
    if (!checkpoint)
        return;
    g_ptr_array_unref(checkpoint->kept);
    g_hash_table_unref(checkpoint->found);
    g_free(checkpoint->path);
    g_free(checkpoint->inputs);
    g_free(checkpoint->note);
    g_free(checkpoint);
}

void checkpoint_set_period(Checkpoint *checkpoint, double seconds) {
    checkpoint->period_us = (gint64)(seconds * G_USEC_PER_SEC);
}

const char *checkpoint_note(const Checkpoint *checkpoint) {
    return checkpoint->note;
}

static char *hash_of(gconstpointer values, gsize size) {
    return g_strdup_printf("%016" G_GINT64_MODIFIER "x", (guint64)XXH3_64bits(values, size));
}

/* Packs bytes into pixels of four bytes, padded with 0. Returns NULL if the array is too large for
 * a file. */
static struct exr_part *to_part(const char *name, gconstpointer values, gsize size) {
    static const char *const bits[] = {"BITS", NULL};
    const gsize words = MAX((size + WORD - 1) / WORD, 1), width = MIN(words, WIDTH);
    const gsize height = (words + width - 1) / width;
    if (height > EXR_MAX_PIXELS / WIDTH)
        return NULL;
    struct exr_part *part = exr_part_new(name, (int)width, (int)height, bits, EXR_FLOAT);
    g_autofree char *bytes = g_strdup_printf("%" G_GSIZE_FORMAT, size);
    g_autofree char *hash = hash_of(values, size);
    memcpy(part->planes[0], values, size);
    exr_set_string(part, "mesorig.bytes", bytes);
    exr_set_string(part, "mesorig.hash", hash);
    return part;
}

/* Copies the arrays of a file into `found`. Returns NULL on success, otherwise a text that says why
 * the file cannot be used. */
static const char *take(Checkpoint *checkpoint, const struct exr_file *file) {
    const struct exr_part *head = exr_file_part(file, HEAD);
    const char *of = NULL, *kind = NULL;
    if (!head || !exr_get_string(head, "mesorig.kind", &kind, NULL) || strcmp(kind, HEAD) != 0 ||
        !exr_get_string(head, "mesorig.inputs", &of, NULL))
        return "is not a checkpoint";
    if (strcmp(of, checkpoint->inputs) != 0)
        return "is of another BTF, of other options or of another version";
    for (guint i = 0; i < file->parts->len; i++) {
        const struct exr_part *part = file->parts->pdata[i];
        const float *plane = exr_part_plane(part, "BITS");
        const char *bytes = NULL, *hash = NULL;
        guint64 size = 0;
        if (!plane || !exr_get_string(part, "mesorig.bytes", &bytes, NULL) ||
            !exr_get_string(part, "mesorig.hash", &hash, NULL) ||
            !g_ascii_string_to_unsigned(
                bytes, 10, 0, WORD * (guint64)part->width * (guint64)part->height, &size, NULL))
            return "is damaged";
        g_autofree char *is = hash_of(plane, size);
        if (strcmp(is, hash) != 0)
            return "is damaged";
        g_hash_table_insert(checkpoint->found, g_strdup(part->name), g_bytes_new(plane, size));
    }
    return NULL;
}

gboolean checkpoint_is_begun(const Checkpoint *checkpoint) {
    return checkpoint->inputs != NULL;
}

void checkpoint_begin(Checkpoint *checkpoint, const char *inputs) {
    if (checkpoint->inputs)
        return;
    checkpoint->inputs = g_strdup(inputs);
    checkpoint->saved_us = g_get_monotonic_time();
    if (!g_file_test(checkpoint->path, G_FILE_TEST_EXISTS))
        return;
    g_autoptr(GError) error = NULL;
    g_autoptr(ExrFile) file = exr_read(checkpoint->path, &error);
    const char *wrong = file ? take(checkpoint, file) : error->message;
    checkpoint->own = wrong == NULL;
    if (wrong)
        g_hash_table_remove_all(checkpoint->found);
    if (error)
        checkpoint->note =
            g_strdup_printf("%s; starting from the beginning", error_details_what(error));
    else if (wrong)
        checkpoint->note =
            g_strdup_printf("%s %s; starting from the beginning", checkpoint->path, wrong);
    else
        checkpoint->note = g_strdup_printf("going on from %s", checkpoint->path);
}

gconstpointer checkpoint_get(const Checkpoint *checkpoint, const char *name, gsize size) {
    GBytes *bytes = g_hash_table_lookup(checkpoint->found, name);
    return bytes && g_bytes_get_size(bytes) == size ? g_bytes_get_data(bytes, NULL) : NULL;
}

static void do_keep(Checkpoint *checkpoint, const char *name, struct array array) {
    checkpoint_drop(checkpoint, name);
    array.name = g_strdup(name);
    g_ptr_array_add(checkpoint->kept, g_memdup2(&array, sizeof array));
}

void checkpoint_keep(Checkpoint *checkpoint, const char *name, gconstpointer values, gsize size) {
    do_keep(checkpoint, name, (struct array){.values = values, .size = size});
}

void checkpoint_keep_flags(Checkpoint *checkpoint, const char *name, const int *flags, int n) {
    do_keep(checkpoint, name, (struct array){.flags = flags, .size = sizeof(int) * (gsize)n});
}

void checkpoint_drop(Checkpoint *checkpoint, const char *name) {
    for (guint i = checkpoint->kept->len; i-- > 0;) {
        const struct array *array = checkpoint->kept->pdata[i];
        if (!name || strcmp(array->name, name) == 0)
            g_ptr_array_remove_index(checkpoint->kept, i);
    }
    if (name)
        g_hash_table_remove(checkpoint->found, name);
    else
        g_hash_table_remove_all(checkpoint->found);
}

/* Copies the arrays into a file. Flags are copied first, so that a value that a thread writes
 * during the copy does not count as done. Returns NULL if an array is too large for a file. */
static struct exr_file *to_file(const Checkpoint *checkpoint) {
    g_autoptr(ExrFile) file = exr_file_new();
    struct exr_part *head = to_part(HEAD, "", 0);
    exr_set_string(head, "mesorig.kind", HEAD);
    exr_set_string(head, "mesorig.inputs", checkpoint->inputs);
    exr_file_add(file, head);
    for (int pass = 0; pass < 2; pass++)
        for (guint i = 0; i < checkpoint->kept->len; i++) {
            const struct array *array = checkpoint->kept->pdata[i];
            if ((array->flags != NULL) != (pass == 0))
                continue;
            const gsize n_flags = array->flags ? array->size / sizeof(int) : 0;
            g_autofree int *flags = g_new(int, n_flags);
            for (gsize k = 0; k < n_flags; k++)
                flags[k] = g_atomic_int_get(&array->flags[k]);
            struct exr_part *part =
                to_part(array->name, flags ? flags : array->values, array->size);
            if (!part)
                return NULL;
            exr_file_add(file, part);
        }
    return g_steal_pointer(&file);
}

void checkpoint_save(Checkpoint *checkpoint) {
    const gint64 begun_us = g_get_monotonic_time();
    if (!checkpoint->inputs || checkpoint->kept->len == 0)
        return;
    g_autoptr(ExrFile) file = to_file(checkpoint);
    if (file && exr_write(checkpoint->path, file, EXR_NONE, TRUE, NULL))
        checkpoint->own = TRUE;
    checkpoint->saved_us = g_get_monotonic_time();
    checkpoint->took_us = checkpoint->saved_us - begun_us;
}

void checkpoint_save_if_due(Checkpoint *checkpoint) {
    const gint64 since_us = g_get_monotonic_time() - checkpoint->saved_us;
    /* A save that takes long is followed by a longer pause (SHARE). */
    if (since_us >= checkpoint->period_us &&
        (checkpoint->period_us == 0 || since_us > SHARE * checkpoint->took_us))
        checkpoint_save(checkpoint);
}

void checkpoint_remove(Checkpoint *checkpoint) {
    checkpoint_drop(checkpoint, NULL);
    g_unlink(checkpoint->path);
}

void checkpoint_discard(Checkpoint *checkpoint) {
    if (checkpoint->own)
        checkpoint_remove(checkpoint);
}
