#include "world_cache.h"

#include "samples/sample.h"

#include <string.h>

struct node {
    struct cache_entry entry; /* must be the first member */
    struct cache_key key;
    gsize bytes;
    int users;
    gboolean ready;
    GList link; /* element of the queue `recent`, but only if ready is TRUE */
};

struct Cache {
    GMutex lock;
    GCond made;
    GHashTable *nodes;
    GQueue recent; /* the most recently used node first */
    gsize bytes, limit;
};

static guint key_hash(gconstpointer p) {
    const struct cache_key *key = p;
    guint64 h = 0;
    for (int i = 0; i < 4; i++)
        h = sample_hash(h + key->words[i] + 0x9e3779b97f4a7c15u);
    return (guint)h;
}

static gboolean key_equal(gconstpointer a, gconstpointer b) {
    return memcmp(a, b, sizeof(struct cache_key)) == 0;
}

static void node_free(gpointer p) {
    struct node *node = p;
    g_free(node->entry.value);
    g_free(node);
}

Cache *cache_new(gsize limit_bytes) {
    Cache *cache = g_new0(Cache, 1);
    g_mutex_init(&cache->lock);
    g_cond_init(&cache->made);
    cache->nodes = g_hash_table_new_full(key_hash, key_equal, NULL, node_free);
    cache->limit = limit_bytes;
    return cache;
}

void cache_free(Cache *cache) {
    if (!cache)
        return;
    g_hash_table_unref(cache->nodes);
    g_mutex_clear(&cache->lock);
    g_cond_clear(&cache->made);
    g_free(cache);
}

struct cache_entry *cache_get(Cache *cache, const struct cache_key *key, CacheMake make,
                              gconstpointer data) {
    g_mutex_lock(&cache->lock);
    struct node *node = g_hash_table_lookup(cache->nodes, key);
    if (node) {
        node->users++;
        while (!node->ready)
            g_cond_wait(&cache->made, &cache->lock);
        g_queue_unlink(&cache->recent, &node->link);
    } else {
        node = g_new0(struct node, 1);
        *node = (struct node){.key = *key, .users = 1, .link.data = node};
        g_hash_table_insert(cache->nodes, &node->key, node);
        g_mutex_unlock(&cache->lock);
        node->entry.value = make(key, data, &node->bytes);
        g_mutex_lock(&cache->lock);
        node->ready = TRUE;
        cache->bytes += node->bytes;
        g_cond_broadcast(&cache->made);
    }
    g_queue_push_head_link(&cache->recent, &node->link);
    /* Unused values are removed until the cache is small enough, beginning with the least recently
     * used value. */
    GList *last = cache->recent.tail;
    while (last && cache->bytes > cache->limit) {
        GList *before = last->prev;
        struct node *old = last->data;
        if (old->users == 0) {
            g_queue_unlink(&cache->recent, last);
            cache->bytes -= old->bytes;
            g_hash_table_remove(cache->nodes, &old->key);
        }
        last = before;
    }
    g_mutex_unlock(&cache->lock);
    return &node->entry;
}

void cache_release(Cache *cache, struct cache_entry *entry) {
    g_mutex_lock(&cache->lock);
    ((struct node *)entry)->users--;
    g_mutex_unlock(&cache->lock);
}
