/* 16-bit port access to a JR3 ISA receiver, and a thread that misses no sample of it.
 *
 * Built by `python -m services.sensor_jr3.build_port`. The address goes to the base port, the word comes from or goes
 * to base + 2. The two cycles are one under a lock: otherwise a reader in between moves the address. The lock holds
 * within this process; only one process may use a card.
 */
#define _GNU_SOURCE
#include <pthread.h>
#include <stdatomic.h>
#include <stdint.h>
#include <sys/io.h>
#include <time.h>

enum { WORDS = 9, ROOM = 8192 }; /* about a second at 8 kHz */

typedef struct {
    uint16_t words[WORDS];
    int64_t t_ns;
} sample_t;

static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
static pthread_t sampler;
static sample_t ring[ROOM];
static atomic_uint written, taken;
static atomic_int running;
static uint16_t base_port, counter_at, data_at;
static long pause_ns;

static uint16_t word_at(uint16_t base, uint16_t address)
{
    outw(address, base);
    return inw(base + 2);
}

static int64_t now_ns(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (int64_t)now.tv_sec * 1000000000 + now.tv_nsec;
}

int jr3_open(uint16_t base)
{
    return ioperm(base, 4, 1);
}

void jr3_read(uint16_t base, uint16_t address, uint16_t count, uint16_t *words)
{
    pthread_mutex_lock(&lock);
    for (int i = 0; i < count; i++)
        words[i] = word_at(base, address + i);
    pthread_mutex_unlock(&lock);
}

void jr3_write(uint16_t base, uint16_t address, uint16_t value)
{
    pthread_mutex_lock(&lock);
    outw(address, base);
    outw(value, base + 2);
    pthread_mutex_unlock(&lock);
}

/* Take the sample whose counter is `counter`; 0 when the next one came meanwhile, so that its words may be of both. */
static int take(uint16_t counter, sample_t *into)
{
    uint16_t after;
    pthread_mutex_lock(&lock);
    into->words[0] = counter;
    for (int i = 0; i < 6; i++)
        into->words[1 + i] = word_at(base_port, data_at + i);
    into->words[7] = word_at(base_port, 0xF0);
    into->words[8] = word_at(base_port, 0xF1);
    after = word_at(base_port, counter_at);
    pthread_mutex_unlock(&lock);
    return after == counter;
}

static void *sample(void *nothing)
{
    struct timespec rest = {0, pause_ns};
    int64_t looked_ns = now_ns();
    uint16_t last;
    jr3_read(base_port, counter_at, 1, &last);
    while (atomic_load(&running)) {
        int64_t looks_ns = now_ns();
        uint16_t counter;
        sample_t fresh;
        /* It came after the look before: this thread may have stood still since, and a time must not be too late. */
        fresh.t_ns = looked_ns;
        jr3_read(base_port, counter_at, 1, &counter);
        looked_ns = looks_ns;
        if (counter == last) {
            if (pause_ns)
                nanosleep(&rest, 0);
            continue;
        }
        if (!take(counter, &fresh))
            continue;
        last = counter;
        unsigned at = atomic_load(&written);
        if (at - atomic_load(&taken) < ROOM) { /* else it is lost, and the counters show it */
            ring[at % ROOM] = fresh;
            atomic_store(&written, at + 1);
        }
    }
    return nothing;
}

void jr3_stop(void)
{
    if (atomic_exchange(&running, 0))
        pthread_join(sampler, 0);
}

/* Begin to take the samples at which the word at `counter` changes, looking every `rest_ns`, or all the time for 0. */
int jr3_watch(uint16_t base, uint16_t counter, uint16_t data, long rest_ns)
{
    int failed;
    jr3_stop();
    base_port = base, counter_at = counter, data_at = data, pause_ns = rest_ns;
    atomic_store(&written, 0);
    atomic_store(&taken, 0);
    /* On Linux a port permission is a thread's; a new thread inherits it. */
    atomic_store(&running, 1);
    failed = pthread_create(&sampler, 0, sample, 0);
    if (failed)
        atomic_store(&running, 0);
    return failed;
}

/* Return up to `most` samples, WORDS words each, waiting at most `wait_ns` for the first; the newest one's time too. */
int jr3_collect(int most, int64_t wait_ns, uint16_t *words, int64_t *newest_ns)
{
    const struct timespec rest = {0, 200000};
    int64_t until = now_ns() + wait_ns;
    unsigned at = atomic_load(&taken);
    int count = 0;
    while (atomic_load(&written) == at && now_ns() < until)
        nanosleep(&rest, 0);
    for (; count < most && at != atomic_load(&written); count++, at++) {
        const sample_t *one = &ring[at % ROOM];
        for (int i = 0; i < WORDS; i++)
            words[count * WORDS + i] = one->words[i];
        *newest_ns = one->t_ns;
    }
    atomic_store(&taken, at);
    return count;
}

int64_t jr3_now_ns(void)
{
    return now_ns();
}
