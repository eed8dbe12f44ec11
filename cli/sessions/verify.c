/* verify: compares every file of a session with its checksum, and shows the commands that repair
 * damaged files. */
#include "base/file_lock.h"
#include "common/cli.h"
#include "common/work.h"
#include "session/session.h"
#include "sessions.h"

#include <glib/gstdio.h>
#include <string.h>

#define POLL_US     (100 * 1000)
#define PATIENCE_US (10 * G_USEC_PER_SEC)

struct verify {
    const char *path;
    /* results */
    char *directory;
    int n_frames, n_products;
    GPtrArray *frames, *products; /* of struct session_damage */
    GPtrArray *unknown;           /* relative paths */
    /* why damaged frames could not be recorded for mesorig resume; NULL if they were */
    GError *not_noted;
};

static int by_name(gconstpointer a, gconstpointer b) {
    return strcmp(*(char *const *)a, *(char *const *)b);
}

static const char *const folders[] = {"frames", "laser", "products", "products/btf", NULL};

/* Returns whether a file or folder belongs to the session. It does if the database has a row for it
 * (`known`), or if it is:
 * - the database itself, a lock, or the metadata of the research object,
 * - a folder of the session, or a lock or unfinished work among the products,
 * - a folder that has the name of a frame and contains the frame's raw pictures. */
static gboolean is_expected(const char *path, gboolean folder, GHashTable *known) {
    static const char *const files[] = {"session.db",   "session.db-wal",         "session.db-shm",
                                        "capture.lock", "ro-crate-metadata.json", NULL};
    g_autofree char *frame = g_strconcat(path, ".exr", NULL);

    if (g_strv_contains(folder ? folders : files, path))
        return TRUE;
    if (g_str_has_prefix(path, "products/"))
        return !folder && (g_hash_table_contains(known, path) || g_str_has_suffix(path, ".lock") ||
                           g_str_has_suffix(path, ".checkpoint"));
    return g_hash_table_contains(known, folder ? frame : path);
}

static void find_unknown(struct verify *verify, const char *folder, GHashTable *known) {
    g_autofree char *path = g_build_filename(verify->directory, folder, NULL);
    g_autoptr(GDir) dir = g_dir_open(path, 0, NULL);

    for (const char *name; dir && (name = g_dir_read_name(dir));) {
        g_autofree char *relative = *folder ? g_build_filename(folder, name, NULL) : g_strdup(name);
        g_autofree char *file = g_build_filename(path, name, NULL);
        GStatBuf status;
        const gboolean is_folder = g_lstat(file, &status) == 0 && S_ISDIR(status.st_mode);
        if (!is_expected(relative, is_folder, known))
            g_ptr_array_add(verify->unknown, g_steal_pointer(&relative));
        else if (is_folder && g_strv_contains(folders, relative))
            find_unknown(verify, relative, known);
    }
}

/* Finds the damaged products and the unknown files. */
static gboolean examine(struct verify *verify, Session *session, const struct work *work,
                        GError **error) {
    g_clear_pointer(&verify->products, g_ptr_array_unref);
    g_clear_pointer(&verify->unknown, g_ptr_array_unref);
    verify->products =
        session_find_damage(session, SESSION_PRODUCTS_MADE, "", work, &verify->n_products, error);
    g_autoptr(GHashTable) known = verify->products ? session_products(session, error) : NULL;
    g_autoptr(GPtrArray) frames = known ? session_frames(session, error) : NULL;
    if (!frames)
        return FALSE;
    for (guint i = 0; i < frames->len; i++)
        g_hash_table_add(known, g_strdup(((struct session_frame *)frames->pdata[i])->path));
    verify->unknown = g_ptr_array_new_with_free_func(g_free);
    find_unknown(verify, "", known);
    g_ptr_array_sort(verify->unknown, by_name);
    return TRUE;
}

/* Examines the session until the result is final. A program that makes products writes a file
 * shortly before the file's row in the database. While such a program is at work, files that seem
 * to be wrong are therefore examined again, for a limited time. */
static gboolean examine_settled(struct verify *verify, Session *session, const struct work *work,
                                GError **error) {
    g_autofree char *lock = session_file(session, SESSION_PROCESS_LOCK);
    const gint64 until_us = g_get_monotonic_time() + PATIENCE_US;
    for (;;) {
        const gboolean held = file_lock_is_held(lock);
        if (!examine(verify, session, work, error))
            return FALSE;
        if (verify->products->len + verify->unknown->len == 0 || !held ||
            g_get_monotonic_time() >= until_us)
            return TRUE;
        g_usleep(POLL_US);
    }
}

static gboolean work_verify(const struct work *work, gpointer data, GError **error) {
    struct verify *verify = data;
    g_autoptr(Session) session = session_open(verify->path, SESSION_PRODUCTS, NULL);

    if (!session && !(session = session_open(verify->path, SESSION_READ, error)))
        return FALSE;
    verify->directory = g_strdup(session_path(session));
    verify->frames =
        session_find_damage(session, SESSION_FRAMES, "", work, &verify->n_frames, error);
    if (!verify->frames)
        return FALSE;
    /* Record the damaged frames, because mesorig resume compares checksums only of recorded
     * frames. */
    for (guint i = 0; i < verify->frames->len && !verify->not_noted; i++) {
        const struct session_damage *damage = verify->frames->pdata[i];
        session_note_damage(session, damage->path, damage->what, &verify->not_noted);
    }
    return examine_settled(verify, session, work, error);
}

static void add_damages(Record *to, const GPtrArray *damages, gboolean missing) {
    for (guint i = 0; i < damages->len; i++) {
        const struct session_damage *damage = damages->pdata[i];
        if (damage->missing != missing)
            continue;
        record_begin(to, NULL);
        record_add(to, "%s{path} %s{what} %s{repair}", damage->path, damage->what, damage->remedy);
        record_end(to);
    }
}

static void tell_damages(Record *to, const GPtrArray *damages, GPtrArray *remedies) {
    for (guint i = 0; i < damages->len; i++) {
        const struct session_damage *damage = damages->pdata[i];
        const char *remedy = damage->remedy ? damage->remedy : "import the session again";
        record_say(to, "%-9s %s: %s\n", damage->missing ? "missing" : "damaged", damage->path,
                   damage->what);
        if (!g_ptr_array_find_with_equal_func(remedies, remedy, g_str_equal, NULL))
            g_ptr_array_add(remedies, (gpointer)remedy);
    }
}

static void tell(Record *to, const struct verify *verify) {
    g_autoptr(GPtrArray) remedies = g_ptr_array_new();
    record_add(to, "%d{frames} %d{products}", verify->n_frames, verify->n_products);
    for (int missing = 0; missing < 2; missing++) {
        record_begin_list(to, missing ? "missing" : "damaged");
        add_damages(to, verify->frames, missing);
        add_damages(to, verify->products, missing);
        record_end(to);
    }
    record_strings(to, "unknown", verify->unknown);
    tell_damages(to, verify->frames, remedies);
    tell_damages(to, verify->products, remedies);
    for (guint i = 0; i < verify->unknown->len; i++) {
        g_autofree char *shown = g_strescape(verify->unknown->pdata[i], NULL);
        record_say(to,
                   "unknown   %s: the session does not list this file; move it away, or leave it\n",
                   shown);
    }
    record_say(
        to,
        "files of frames: %d, of products: %d: %u are damaged or missing, %u other files are "
        "unknown\n",
        verify->n_frames, verify->n_products, verify->frames->len + verify->products->len,
        verify->unknown->len);
    for (guint i = 0; i < remedies->len; i++)
        record_say(to, "to repair %s\n", (const char *)remedies->pdata[i]);
    if (verify->not_noted && !cli_json)
        g_printerr("the damaged frames could not be recorded, so mesorig resume does not take them "
                   "again: %s; run mesorig verify again as a user who may write into the session, "
                   "with space on its disk\n",
                   verify->not_noted->message);
}

static int run(const struct call *call, GError **error) {
    struct verify verify = {.path = call->arguments[0]};
    gboolean whole = cli_work_run(work_verify, &verify, NULL, error);
    if (whole) {
        tell(call->record, &verify);
        whole = verify.frames->len + verify.products->len + verify.unknown->len == 0;
    }
    g_clear_pointer(&verify.frames, g_ptr_array_unref);
    g_clear_pointer(&verify.products, g_ptr_array_unref);
    g_clear_pointer(&verify.unknown, g_ptr_array_unref);
    g_free(verify.directory);
    g_clear_error(&verify.not_noted);
    return whole ? CLI_DONE : CLI_FAILED;
}

const struct command cli_verify = {.name = "verify",
                                   .arguments = "DIR",
                                   .examples = "  mesorig verify weave.session\n",
                                   .help = "Compare every file of a session with its checksum. "
                                           "Shows the command that repairs a damaged file.",
                                   .min = 1,
                                   .max = 1,
                                   .run = run};
