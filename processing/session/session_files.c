/* Lists the files of a session and compares them with the checksums in the database. Hashes are
 * kept for the life of the process, because several commands verify the same products. */
#include "session_private.h"

#include "base/data_error.h"
#include "base/input_file.h"

#include "base/file_lock.h"
#include "exr/exr.h"

#include <errno.h>
#include <gio/gio.h>
#include <stdint.h>
#include <string.h>
#include <sys/stat.h>

/* maximum time to wait for the row of a file whose program has written the file, but not the row
 * yet */
#define PATIENCE_US (10 * G_USEC_PER_SEC)
#define POLL_US     (G_USEC_PER_SEC / 10)

static GMutex known_mutex;
static GHashTable *known; /* maps the identity of a file when it was hashed to its SHA-256 */

static gint64 nanoseconds(const struct timespec *time) {
    return (gint64)time->tv_sec * G_GINT64_CONSTANT(1000000000) + time->tv_nsec;
}

static char *find_known(const char *identity) {
    g_mutex_lock(&known_mutex);
    char *sha256 = known ? g_strdup(g_hash_table_lookup(known, identity)) : NULL;
    g_mutex_unlock(&known_mutex);
    return sha256;
}

static void keep_known(const char *identity, const char *sha256) {
    g_mutex_lock(&known_mutex);
    if (!known)
        known = g_hash_table_new_full(g_str_hash, g_str_equal, g_free, g_free);
    g_hash_table_replace(known, g_strdup(identity), g_strdup(sha256));
    g_mutex_unlock(&known_mutex);
}

/* Returns the SHA-256 of a file. If the file is missing, unreadable, or not a regular file, returns
 * NULL and gives the reason as a text in *ret_wrong. */
static char *hash_file(const char *path, gboolean *ret_missing, gboolean *ret_unreadable,
                       char **ret_wrong) {
    struct stat status;
    g_autoptr(GError) error = NULL;

    *ret_missing = *ret_unreadable = FALSE;
    if (lstat(path, &status) != 0) {
        *ret_missing = errno == ENOENT || errno == ENOTDIR;
        *ret_unreadable = !*ret_missing;
        *ret_wrong = g_strdup(*ret_missing ? "it is gone" : g_strerror(errno));
        return NULL;
    }
    if (S_ISLNK(status.st_mode)) {
        struct stat target;
        *ret_wrong = g_strdup_printf(
            "it is a symbolic link to something that is %s, not a regular file of the session",
            stat(path, &target) == 0 ? input_file_kind(target.st_mode) : "not there");
        return NULL;
    }
    if (!S_ISREG(status.st_mode)) {
        *ret_wrong =
            g_strdup_printf("it is %s, not a regular file", input_file_kind(status.st_mode));
        return NULL;
    }
    /* While device, inode, size and times of the file stay the same, the file is not hashed
     * again. */
    const gint64 changed_ns = nanoseconds(&status.st_ctim);
    g_autofree char *identity =
        g_strdup_printf("%ju %ju %jd %" G_GINT64_FORMAT " %" G_GINT64_FORMAT,
                        (uintmax_t)status.st_dev, (uintmax_t)status.st_ino,
                        (intmax_t)status.st_size, nanoseconds(&status.st_mtim), changed_ns);
    char *sha256 = find_known(identity);
    if (sha256)
        return sha256;
    sha256 = exr_sha256(path, NULL, &error);
    *ret_unreadable = sha256 == NULL;
    /* A file that changed within the current clock tick of the file system may change again without
     * a new time stamp. Its hash is therefore not kept. */
    if (!sha256)
        *ret_wrong = g_strdup(error->message);
    else if (g_get_real_time() * 1000 - changed_ns > 50 * 1000000)
        keep_known(identity, sha256);
    return sha256;
}

void session_damage_free(struct session_damage *damage) {
    if (!damage)
        return;
    g_free(damage->path);
    g_free(damage->what);
    g_free(damage->remedy);
    g_free(damage->sha256);
    g_free(damage);
}

struct session_damage *session_examine(const Session *session, const char *relative,
                                       const char *sha256) {
    g_autofree char *file = session_file(session, relative), *wrong = NULL;
    gboolean missing = FALSE, unreadable = FALSE;
    g_autofree char *found = hash_file(file, &missing, &unreadable, &wrong);

    if (found && strcmp(found, sha256) == 0)
        return NULL;
    struct session_damage *damage = g_new0(struct session_damage, 1);
    damage->path = g_strdup(relative);
    damage->missing = missing;
    damage->unreadable = unreadable;
    damage->sha256 = g_strdup(sha256);
    damage->what =
        wrong ? g_steal_pointer(&wrong)
              : g_strdup_printf("its SHA-256 is %s, but the session has %s", found, sha256);
    return damage;
}

static char *remedy_of(Session *session, gboolean frames, const char *made_by) {
    g_autofree char *directory = g_shell_quote(session->path);
    g_autofree char *imported = session_value(session, frames ? "imported_frames" : "imported");

    if (g_str_has_prefix(made_by, "compress") || g_str_has_prefix(made_by, "export "))
        return g_strdup_printf("mesorig %s %s", made_by, directory);
    return imported ? NULL
                    : g_strdup_printf("mesorig %s %s", frames ? "resume" : "process", directory);
}

struct row {
    char *path, *sha256, *made_by;
};

static void row_free(gpointer data) {
    struct row *row = data;

    g_free(row->path);
    g_free(row->sha256);
    g_free(row->made_by);
    g_free(row);
}

/* Reads the rows of the files whose paths begin with prefix. */
static GPtrArray *read_rows(Session *session, gboolean frames, const char *prefix, GError **error) {
    g_autoptr(GPtrArray) rows = g_ptr_array_new_with_free_func(row_free);
    g_autoptr(sqlite3_stmt) statement = session_db_query(
        session, error,
        frames ? "SELECT path, sha256, '' FROM frame WHERE substr(path, 1, length(?1)) = ?1"
                 " ORDER BY path"
               : "SELECT path, sha256, made_by FROM product"
                 " WHERE substr(path, 1, length(?1)) = ?1 ORDER BY path",
        "s", prefix);
    int rc = -1;

    while (statement && (rc = session_db_next(session, statement, error)) > 0) {
        struct row *row = g_new0(struct row, 1);

        row->path = session_db_text(statement, 0);
        row->sha256 = session_db_text(statement, 1);
        row->made_by = session_db_text(statement, 2);
        g_ptr_array_add(rows, row);
        if (!session_is_relative(row->path)) {
            session_fail(
                error, SESSION_ERROR_FORMAT,
                "%s/session.db: “%s”, the path of a %s, leads out of the session; restore the "
                "database from a copy",
                session->path, row->path, frames ? "frame" : "product");
            return NULL;
        }
    }
    return rc == 0 ? g_steal_pointer(&rows) : NULL;
}

GHashTable *session_products(Session *session, GError **error) {
    g_autoptr(GHashTable) products = g_hash_table_new_full(g_str_hash, g_str_equal, g_free, NULL);
    g_autoptr(GPtrArray) rows = read_rows(session, FALSE, "", error);

    for (guint i = 0; rows && i < rows->len; i++)
        g_hash_table_add(products, g_strdup(((struct row *)g_ptr_array_index(rows, i))->path));
    return rows ? g_steal_pointer(&products) : NULL;
}

static void product_free(gpointer data) {
    struct session_product *product = data;

    g_free(product->path);
    g_free(product->made_by);
    g_free(product->sha256);
    g_free(product);
}

GPtrArray *session_list_products(Session *session, GError **error) {
    g_autoptr(GPtrArray) products = g_ptr_array_new_with_free_func(product_free);
    g_autoptr(sqlite3_stmt) statement = session_db_query(
        session, error, "SELECT path, made_by, sha256, bytes FROM product ORDER BY path", "");
    int rc = -1;

    while (statement && (rc = session_db_next(session, statement, error)) > 0) {
        struct session_product *product = g_new0(struct session_product, 1);

        product->path = session_db_text(statement, 0);
        product->made_by = session_db_text(statement, 1);
        product->sha256 = session_db_text(statement, 2);
        product->bytes = sqlite3_column_int64(statement, 3);
        g_ptr_array_add(products, product);
    }
    return rc == 0 ? g_steal_pointer(&products) : NULL;
}

struct examination {
    const Session *session;
    const GPtrArray *rows;
    struct session_damage **damages; /* for each row; NULL if it is not damaged */
};

static void examine_row(int number, gpointer data) {
    struct examination *examination = data;
    const struct row *row = g_ptr_array_index(examination->rows, (guint)number);

    examination->damages[number] = session_examine(examination->session, row->path, row->sha256);
}

/* The rows are read first. The files are then hashed in parallel, without access to the
 * database. */
GPtrArray *session_find_damage(Session *session, enum session_files files, const char *prefix,
                               const struct work *work, int *ret_examined, GError **error) {
    const gboolean frames = files == SESSION_FRAMES;
    g_autoptr(GPtrArray) rows = read_rows(session, frames, prefix, error);
    if (!rows)
        return NULL;
    g_autofree struct session_damage **damages = g_new0(struct session_damage *, rows->len + 1);
    struct examination examination = {session, rows, damages};
    GPtrArray *ret = g_ptr_array_new_with_free_func((GDestroyNotify)session_damage_free);
    const gboolean ok =
        work_parallel(work, "verify", (int)rows->len, examine_row, &examination, error);

    for (guint i = 0; i < rows->len; i++)
        if (damages[i]) {
            const struct row *row = g_ptr_array_index(rows, i);
            damages[i]->remedy = remedy_of(session, frames, row->made_by);
            g_ptr_array_add(ret, damages[i]);
        }
    if (ret_examined)
        *ret_examined = (int)rows->len;
    if (!ok)
        g_clear_pointer(&ret, g_ptr_array_unref);
    return ret;
}

/* Repeats the check if a program was making products when the check began, because such a program
 * writes a file shortly before its row. */
gboolean session_check_products(Session *session, const char *prefix, const struct work *work,
                                GError **error) {
    const struct work silent = {.n_threads = work ? work->n_threads : 0,
                                .cancellable = work ? work->cancellable : NULL};
    g_autofree char *lock = session_file(session, SESSION_PROCESS_LOCK);
    const gint64 until_us = g_get_monotonic_time() + PATIENCE_US;

    for (;;) {
        const gboolean held = file_lock_is_held(lock);
        g_autoptr(GPtrArray) damages =
            session_find_damage(session, SESSION_PRODUCTS_MADE, prefix, &silent, NULL, error);
        if (!damages || damages->len == 0)
            return damages != NULL;
        if (g_get_monotonic_time() >= until_us || !held) {
            const struct session_damage *damage = g_ptr_array_index(damages, 0);
            const char *remedy = damage->remedy;
            return session_fail(error, SESSION_ERROR_DAMAGED, "%s/%s: damaged: %s; %s%s%s",
                                session->path, damage->path, damage->what, remedy ? "`" : "",
                                remedy ? remedy : "import the session again",
                                remedy ? "` makes it again" : "");
        }
        g_usleep(POLL_US);
    }
}

/* Returns the directory of the session to which a file in products/… or products/btf/… belongs, or
 * NULL if there is none. *ret_relative then points to the part of `file` that is relative to that
 * directory. */
static char *session_of(const char *file, const char **ret_relative) {
    static const char *const folders[] = {"/products", "/products/btf"};
    g_autofree char *inner = g_path_get_dirname(file);

    for (gsize i = 0; i < G_N_ELEMENTS(folders); i++) {
        if (!g_str_has_suffix(inner, folders[i]))
            continue;
        g_autofree char *directory = g_strndup(inner, strlen(inner) - strlen(folders[i]));
        g_autofree char *database = g_build_filename(directory, "session.db", NULL);
        if (!g_file_test(database, G_FILE_TEST_EXISTS))
            return NULL;
        *ret_relative = file + strlen(directory) + 1;
        return g_steal_pointer(&directory);
    }
    return NULL;
}

gboolean session_check_product(const char *path, GError **error) {
    g_autofree char *file = g_canonicalize_filename(path, NULL);
    const char *relative = NULL;
    g_autofree char *directory = session_of(file, &relative);

    if (!directory)
        return TRUE;
    g_autoptr(Session) session = session_open(directory, SESSION_READ, error);
    return session && session_check_products(session, relative, NULL, error);
}

GPtrArray *session_btf_files(Session *session, GError **error) {
    g_autoptr(GPtrArray) views = session_check_products(session, "products/btf/", NULL, error)
                                     ? session_views(session, error)
                                     : NULL;
    g_autoptr(GPtrArray) files = g_ptr_array_new_with_free_func(g_free);
    for (guint i = 0; views && i < views->len; i++) {
        const struct session_direction *view = views->pdata[i];
        g_autofree char *relative = g_strdup_printf("products/btf/view_%04d.exr", view->index);
        g_autofree char *file = session_file(session, relative);
        if (g_file_test(file, G_FILE_TEST_EXISTS))
            g_ptr_array_add(files, g_steal_pointer(&file));
    }
    if (views && files->len == 0)
        g_set_error(error, DATA_ERROR, DATA_ERROR_INCOMPLETE,
                    "%s: there is no BTF yet; “mesorig process” makes it", session_path(session));
    return files->len > 0 ? g_steal_pointer(&files) : NULL;
}

gboolean session_add_product_file(const char *path, const char *made_by, GError **error) {
    g_autofree char *file = g_canonicalize_filename(path, NULL);
    const char *relative = NULL;
    g_autofree char *directory = session_of(file, &relative);

    if (!directory)
        return TRUE;
    g_autoptr(Session) session = session_open(directory, SESSION_PRODUCTS, error);
    return session && session_add_product(session, relative, made_by, error);
}
