/*
 * A cache that keeps parts of pictures, up to a limit of memory. When the limit is exceeded, unused
 * parts are removed, beginning with the least recently used one. A part is in use between
 * cache_get() and cache_release(). Parts in use may together exceed the limit.
 *
 * A value depends only on its key, so the cache never changes a picture.
 *
 * Any thread may call the functions. If two threads request the same value, the first thread makes
 * the value and the second thread waits. No lock is held while a value is made.
 */
#pragma once

#include <glib.h>

struct cache_key {
    guint64 words[4];
};

struct cache_entry {
    gpointer value; /* a block allocated with g_malloc() */
};

typedef struct Cache Cache;

/* Makes the value of a key. Returns a block that the cache frees with g_free(), and sets *ret_bytes
 * to the size of the block. The function may get the values of other keys from the cache. Keys must
 * not depend on each other in a circle. */
typedef gpointer (*CacheMake)(const struct cache_key *key, gconstpointer data, gsize *ret_bytes);

Cache *cache_new(gsize limit_bytes);
void cache_free(Cache *cache); /* NULL is ignored */

/* Returns the value of a key. If the value is not in the cache, make() makes it. The value stays
 * valid until cache_release(). */
struct cache_entry *cache_get(Cache *cache, const struct cache_key *key, CacheMake make,
                              gconstpointer data);
void cache_release(Cache *cache, struct cache_entry *entry);
