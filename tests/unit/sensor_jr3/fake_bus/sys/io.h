/* A bus with a card at 0x260, in place of the system's header: what the helper is compiled against in its tests.
 *
 * Counter 1 steps every 1/8000 s, counter 3 every 1/500 s; each word of filter 0 is counter 1 and each of filter 3 is
 * counter 3 at the moment of reading, so that words of two samples would show. What is written can be read again.
 */
#include <stdint.h>
#include <time.h>

static uint16_t latched, store[0x400];

static uint16_t steps(long period_ns)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (uint16_t)(((int64_t)now.tv_sec * 1000000000 + now.tv_nsec) / period_ns);
}

static int ioperm(unsigned long from, unsigned long count, int on)
{
    return from == 0x300 ? -1 : (int)(count != 4 || !on);
}

static void outw(uint16_t value, uint16_t port)
{
    if (port == 0x260)
        latched = value;
    else if (port == 0x262 && latched < 0x400)
        store[latched] = value;
}

static uint16_t inw(uint16_t port)
{
    if (port != 0x262 || latched >= 0x400)
        return 0xFFFF;
    if (latched == 0xE8 || (latched >= 0x90 && latched < 0x96))
        return steps(125000);
    if (latched == 0xEA || (latched >= 0xA8 && latched < 0xAE))
        return steps(2000000);
    return store[latched];
}
