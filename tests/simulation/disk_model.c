#include "disk_model.h"

#include <errno.h>
#include <fcntl.h>
#include <ftw.h>
#include <glib/gstdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#define SECTOR 512

struct change { /* of a file since its last fsync() */
    gint64 offset;
    GBytes *data; /* NULL: offset is the new length */
    gboolean lost;
};

struct node { /* a file or a folder */
    gboolean folder;
    guint64 inode;
    GByteArray *now, *medium; /* of a file */
    GArray *changes;          /* of struct change */
    GHashTable *names, *kept; /* of a folder: name → node, now and on the medium */
    GArray *renamed;          /* of struct renaming */
};

struct renaming { /* a change of a folder since its last fsync() */
    char *name, *other;
    struct node *node; /* NULL: name is removed */
};

struct DiskModel {
    char *root;
    struct node *top;
    GPtrArray *nodes;     /* all, owned */
    GHashTable *by_inode; /* → node */
    GPtrArray *placed;    /* of struct placed: synced writes since the power last failed */
};

struct placed {
    struct node *node;
    gint64 offset;
    GBytes *data;
};

static void change_clear(gpointer data) {
    g_clear_pointer(&((struct change *)data)->data, g_bytes_unref);
}

static void renaming_clear(gpointer data) {
    struct renaming *renaming = data;
    g_free(renaming->name);
    g_free(renaming->other);
}

static void placed_free(gpointer data) {
    struct placed *placed = data;
    g_bytes_unref(placed->data);
    g_free(placed);
}

static void node_free(gpointer data) {
    struct node *node = data;
    g_byte_array_unref(node->now);
    g_byte_array_unref(node->medium);
    g_array_unref(node->changes);
    g_array_unref(node->renamed);
    g_hash_table_unref(node->names);
    g_hash_table_unref(node->kept);
    g_free(node);
}

static struct node *node_new(DiskModel *model, gboolean folder, guint64 inode) {
    struct node *node = g_new0(struct node, 1);
    node->folder = folder;
    node->inode = inode;
    node->now = g_byte_array_new();
    node->medium = g_byte_array_new();
    node->changes = g_array_new(FALSE, FALSE, sizeof(struct change));
    g_array_set_clear_func(node->changes, change_clear);
    node->renamed = g_array_new(FALSE, FALSE, sizeof(struct renaming));
    g_array_set_clear_func(node->renamed, renaming_clear);
    node->names = g_hash_table_new_full(g_str_hash, g_str_equal, g_free, NULL);
    node->kept = g_hash_table_new_full(g_str_hash, g_str_equal, g_free, NULL);
    g_ptr_array_add(model->nodes, node);
    g_hash_table_insert(model->by_inode, GSIZE_TO_POINTER(inode), node);
    return node;
}

/* The part of the database that is not a file but shared memory. */
static gboolean is_memory(const char *name) {
    return g_str_has_suffix(name, "-shm");
}

static void scan(DiskModel *model, struct node *folder, const char *path) {
    g_autoptr(GDir) dir = g_dir_open(path, 0, NULL);
    const char *name;
    while (dir && (name = g_dir_read_name(dir))) {
        g_autofree char *below = g_build_filename(path, name, NULL);
        struct stat status;
        if (is_memory(name) || lstat(below, &status) != 0)
            continue;
        struct node *node = node_new(model, S_ISDIR(status.st_mode), status.st_ino);
        g_hash_table_insert(folder->names, g_strdup(name), node);
        g_hash_table_insert(folder->kept, g_strdup(name), node);
        if (node->folder) {
            scan(model, node, below);
            continue;
        }
        g_autofree char *text = NULL;
        gsize length = 0;
        if (!g_file_get_contents(below, &text, &length, NULL))
            g_error("simulate: cannot read %s", below);
        g_byte_array_append(node->now, (const guint8 *)text, (guint)length);
        g_byte_array_append(node->medium, (const guint8 *)text, (guint)length);
    }
}

static void model_scan(DiskModel *model) {
    struct stat status = {0};
    g_clear_pointer(&model->nodes, g_ptr_array_unref);
    g_clear_pointer(&model->by_inode, g_hash_table_unref);
    g_clear_pointer(&model->placed, g_ptr_array_unref);
    model->nodes = g_ptr_array_new_with_free_func(node_free);
    model->by_inode = g_hash_table_new(NULL, NULL);
    model->placed = g_ptr_array_new_with_free_func(placed_free);
    stat(model->root, &status);
    model->top = node_new(model, TRUE, status.st_ino);
    scan(model, model->top, model->root);
}

DiskModel *disk_model_new(const char *root) {
    DiskModel *model = g_new0(DiskModel, 1);
    model->root = g_strdup(root);
    model_scan(model);
    return model;
}

void disk_model_free(DiskModel *model) {
    if (!model)
        return;
    g_ptr_array_unref(model->placed);
    g_ptr_array_unref(model->nodes);
    g_hash_table_unref(model->by_inode);
    g_free(model->root);
    g_free(model);
}

/* The folder that holds path, and the last part of path. */
static struct node *find_folder(const DiskModel *model, const char *path, const char **ret_name) {
    g_auto(GStrv) parts = g_strsplit(path, "/", -1);
    struct node *at = model->top;
    const char *slash = strrchr(path, '/');
    for (char **part = parts; at && part[1]; part++)
        at = g_hash_table_lookup(at->names, *part);
    *ret_name = slash ? slash + 1 : path;
    if (!at || !at->folder)
        g_error("simulate: the journal names %s, whose folder is not known", path);
    return at;
}

static void write_bytes(GByteArray *to, gint64 offset, GBytes *data) {
    gsize n;
    const guint8 *from = g_bytes_get_data(data, &n);
    const guint before = to->len;
    if ((gsize)offset + n > to->len)
        g_byte_array_set_size(to, (guint)((gsize)offset + n));
    if (offset > before)
        memset(to->data + before, 0, (gsize)offset - before);
    if (n > 0)
        memcpy(to->data + offset, from, n);
}

static void set_length(GByteArray *to, gint64 length) {
    const guint before = to->len;
    g_byte_array_set_size(to, (guint)length);
    if (length > before)
        memset(to->data + before, 0, (gsize)length - before);
}

static void apply(GByteArray *to, const struct change *change) {
    if (change->data)
        write_bytes(to, change->offset, change->data);
    else
        set_length(to, change->offset);
}

static void rename_in(GHashTable *names, const struct renaming *renaming) {
    if (renaming->other)
        g_hash_table_remove(names, renaming->name);
    if (renaming->node)
        g_hash_table_insert(names, g_strdup(renaming->other ? renaming->other : renaming->name),
                            renaming->node);
    else
        g_hash_table_remove(names, renaming->name);
}

static void change_folder(DiskModel *model, const char *path, const char *other,
                          struct node *node) {
    const char *name, *other_name = NULL;
    struct node *folder = find_folder(model, path, &name);
    if (is_memory(name))
        return;
    if (other && find_folder(model, other, &other_name) != folder)
        g_error("simulate: %s is moved to another folder, %s: the model does not know how", path,
                other);
    struct renaming renaming = {g_strdup(name), g_strdup(other_name),
                                other ? g_hash_table_lookup(folder->names, name) : node};
    rename_in(folder->names, &renaming);
    g_array_append_val(folder->renamed, renaming);
}

static void sync_node(DiskModel *model, struct node *node) {
    for (guint i = 0; i < node->renamed->len; i++)
        rename_in(node->kept, &g_array_index(node->renamed, struct renaming, i));
    g_array_set_size(node->renamed, 0);
    for (guint i = 0; i < node->changes->len; i++) {
        const struct change *change = &g_array_index(node->changes, struct change, i);
        if (change->lost)
            continue;
        apply(node->medium, change);
        if (change->data) {
            struct placed *placed = g_new0(struct placed, 1);
            *placed = (struct placed){node, change->offset, g_bytes_ref(change->data)};
            g_ptr_array_add(model->placed, placed);
        }
    }
    g_array_set_size(node->changes, 0);
}

static void read_entry(DiskModel *model, const struct disk_entry *entry) {
    const char *text = (const char *)(entry + 1);
    g_autofree char *name = g_strndup(text, entry->n_name);
    g_autofree char *other = g_strndup(text + entry->n_name, entry->n_other);
    struct node *node = g_hash_table_lookup(model->by_inode, GSIZE_TO_POINTER(entry->inode));
    struct change change = {.offset = entry->offset};
    switch (entry->kind) {
    case ENTRY_FILE:
    case ENTRY_FOLDER:
        change_folder(model, name, NULL,
                      node_new(model, entry->kind == ENTRY_FOLDER, entry->inode));
        break;
    case ENTRY_RENAME:
    case ENTRY_REMOVE:
        change_folder(model, name, entry->kind == ENTRY_RENAME ? other : NULL, NULL);
        break;
    case ENTRY_WRITE:
        change.data = g_bytes_new(text + entry->n_name + entry->n_other, entry->n_data);
        G_GNUC_FALLTHROUGH;
    case ENTRY_SIZE:
        if (node) {
            apply(node->now, &change);
            g_array_append_val(node->changes, change);
        } else {
            change_clear(&change);
        }
        break;
    case ENTRY_SYNC:
        if (node)
            sync_node(model, node);
        break;
    case ENTRY_SYNC_FAILED:
        for (guint i = 0; node && i < node->changes->len; i++)
            g_array_index(node->changes, struct change, i).lost = TRUE;
        break;
    }
}

void disk_model_read(DiskModel *model, struct disk *disk) {
    const guint8 *journal = (const guint8 *)disk->journal;
    for (gsize at = 0; at < disk->n_journal;) {
        const struct disk_entry *entry = (const struct disk_entry *)(gconstpointer)(journal + at);
        read_entry(model, entry);
        at += entry->bytes;
    }
    disk->n_journal = 0;
}

static char *check_folder(const struct node *folder, const char *path) {
    g_autoptr(GDir) dir = g_dir_open(path, 0, NULL);
    const char *name;
    guint n = 0;
    char *differs = NULL;
    while (dir && !differs && (name = g_dir_read_name(dir))) {
        if (is_memory(name))
            continue;
        n++;
        g_autofree char *below = g_build_filename(path, name, NULL);
        const struct node *node = g_hash_table_lookup(folder->names, name);
        if (!node) {
            differs = g_strdup_printf("%s is there", below);
        } else if (node->folder) {
            differs = check_folder(node, below);
        } else {
            g_autofree char *text = NULL;
            gsize length = 0;
            g_file_get_contents(below, &text, &length, NULL);
            if (length != node->now->len ||
                (length > 0 && memcmp(text, node->now->data, length) != 0))
                differs = g_strdup_printf("%s has other contents (%zu bytes, not %u)", below,
                                          length, node->now->len);
        }
    }
    if (!differs && n != g_hash_table_size(folder->names))
        differs =
            g_strdup_printf("%s has %u entries, not %u", path, n, g_hash_table_size(folder->names));
    return differs;
}

char *disk_model_check(DiskModel *model) {
    return check_folder(model->top, model->root);
}

static gboolean is_kept(enum cut_mode mode, GRand *random) {
    return mode == CUT_KEEPS || (mode == CUT_EACH && g_rand_boolean(random));
}

/* What the medium has of a file's unsynced changes. */
static void cut_file(struct node *node, enum cut_mode mode, GRand *random) {
    for (guint i = 0; i < node->changes->len; i++) {
        struct change *change = &g_array_index(node->changes, struct change, i);
        if (change->lost || !is_kept(mode, random))
            continue;
        const gsize n = change->data ? g_bytes_get_size(change->data) : 0;
        if (mode == CUT_EACH && n > SECTOR && g_rand_int_range(random, 0, 3) == 0) {
            const gsize sectors = (gsize)g_rand_int_range(random, 1, (gint32)(n / SECTOR) + 1);
            g_autoptr(GBytes) torn = g_bytes_new_from_bytes(change->data, 0, sectors * SECTOR);
            write_bytes(node->medium, change->offset, torn);
        } else {
            apply(node->medium, change);
        }
    }
}

/* Names in order, so that the same seed draws the same numbers. */
static GList *sorted_names(GHashTable *names) {
    return g_list_sort(g_hash_table_get_keys(names), (GCompareFunc)strcmp);
}

static void cut_folder(struct node *folder, const char *path, enum cut_mode mode, GRand *random) {
    const guint n = folder->renamed->len;
    const guint keep = mode == CUT_LOSES   ? 0
                       : mode == CUT_KEEPS ? n
                                           : (guint)g_rand_int_range(random, 0, (gint32)n + 1);
    for (guint i = 0; i < keep; i++)
        rename_in(folder->kept, &g_array_index(folder->renamed, struct renaming, i));
    if (g_mkdir(path, 0777) != 0)
        g_error("simulate: %s: %s", path, g_strerror(errno));
    g_autoptr(GList) names = sorted_names(folder->kept);
    for (GList *at = names; at; at = at->next) {
        struct node *node = g_hash_table_lookup(folder->kept, at->data);
        g_autofree char *below = g_build_filename(path, at->data, NULL);
        if (node->folder) {
            cut_folder(node, below, mode, random);
            continue;
        }
        cut_file(node, mode, random);
        const int fd = g_open(below, O_WRONLY | O_CREAT | O_TRUNC, 0666);
        if (fd < 0 || write(fd, node->medium->data, node->medium->len) != (gssize)node->medium->len)
            g_error("simulate: %s: %s", below, g_strerror(errno));
        close(fd);
    }
}

/* The path of a file that the medium keeps; NULL: it has no name there. */
static char *path_of_node(const struct node *folder, const struct node *wanted) {
    g_autoptr(GList) names = sorted_names(folder->kept);
    for (GList *at = names; at; at = at->next) {
        const struct node *node = g_hash_table_lookup(folder->kept, at->data);
        if (node == wanted)
            return g_strdup(at->data);
        g_autofree char *below = node->folder ? path_of_node(node, wanted) : NULL;
        if (below)
            return g_build_filename(at->data, below, NULL);
    }
    return NULL;
}

static char *misplace(DiskModel *model, GRand *random) {
    for (int tries = 0; tries < 20 && model->placed->len > 0; tries++) {
        const struct placed *placed =
            model->placed->pdata[g_rand_int_range(random, 0, (gint32)model->placed->len)];
        g_autofree char *path = path_of_node(model->top, placed->node);
        const gint64 room = (gint64)placed->node->medium->len - placed->offset - SECTOR;
        if (!path || !g_str_has_suffix(path, ".exr") || room <= 0)
            continue;
        const gsize n = MIN(g_bytes_get_size(placed->data), (gsize)room);
        g_autoptr(GBytes) part = g_bytes_new_from_bytes(placed->data, 0, n);
        write_bytes(placed->node->medium, placed->offset + SECTOR, part);
        return g_steal_pointer(&path);
    }
    return NULL;
}

static int remove_one(const char *path, const struct stat *status, int type, struct FTW *place) {
    return remove(path);
}

void disk_remove_tree(const char *path) {
    nftw(path, remove_one, 16, FTW_DEPTH | FTW_PHYS);
}

void disk_model_rot(DiskModel *model, const char *path, GRand *random) {
    const char *name;
    const struct node *folder = find_folder(model, path, &name);
    struct node *node = g_hash_table_lookup(folder->names, name);
    if (!node || node->now->len == 0)
        return;
    const gsize at = (gsize)g_rand_int_range(random, 0, (gint32)node->now->len);
    const guint8 bit = (guint8)(1 << g_rand_int_range(random, 0, 8));
    g_autofree char *file = g_build_filename(model->root, path, NULL);
    node->now->data[at] ^= bit;
    if (at < node->medium->len)
        node->medium->data[at] ^= bit;
    const int fd = g_open(file, O_WRONLY, 0);
    if (fd < 0 || pwrite(fd, node->now->data + at, 1, (off_t)at) != 1)
        g_error("simulate: %s: %s", file, g_strerror(errno));
    close(fd);
}

char *disk_model_cut(DiskModel *model, enum cut_mode mode, gboolean misplaces, GRand *random) {
    g_autofree char *left = g_strconcat(model->root, ".left", NULL);
    char *misplaced = misplaces ? misplace(model, random) : NULL;
    cut_folder(model->top, left, mode, random);
    disk_remove_tree(model->root);
    if (g_rename(left, model->root) != 0)
        g_error("simulate: %s: %s", left, g_strerror(errno));
    model_scan(model);
    return misplaced;
}
