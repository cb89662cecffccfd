# One image a service: docker build --build-arg SERVICE=agent -t treenail/agent .
# SERVICE is router, store, task, classifier, agent, sim, viewer, sensor_jr3, sensor_rdt, robot_link, robot_ur or ros2; cli is the
# treenail command with all that it can ask. docker build --target front -t treenail/front . is what stands in front of the viewer.

# Rerun's server takes pictures from whoever reaches it; this one passes on what reads, and nothing else.
FROM debian:bookworm-slim AS front
RUN apt-get update \
    && apt-get install -y --no-install-recommends nginx \
    && apt-get clean && rm -rf /var/lib/apt/lists/*
COPY containers/front.conf containers/front.sh /etc/front/
USER 10001:10001
HEALTHCHECK --interval=5s --timeout=3s --start-period=60s --retries=3 CMD ["bash", "-c", "</dev/tcp/127.0.0.1/9090"]
ENTRYPOINT ["sh", "/etc/front/front.sh"]

FROM debian:bookworm-slim AS python
RUN apt-get update \
    && apt-get install -y --no-install-recommends python3 \
    && apt-get clean && rm -rf /var/lib/apt/lists/*

FROM python AS build
RUN apt-get update \
    && apt-get install -y --no-install-recommends g++ python3-dev python3-venv \
    && apt-get clean && rm -rf /var/lib/apt/lists/*
RUN python3 -m venv /build
WORKDIR /build
ENV PIP_DISABLE_PIP_VERSION_CHECK=1 PIP_NO_CACHE_DIR=1
COPY pyproject.toml requirements.lock containers/needs.py ./
RUN awk '/^[a-z]/ {wanted = /^setuptools==/} wanted' requirements.lock >builder.txt \
    && bin/pip install --quiet --require-hashes -r builder.txt

# What one service needs, and nothing else: the extra of its name in pyproject.toml, as the lock pins it, checked by hash.
FROM build AS installed
ARG SERVICE
RUN python3 needs.py "$SERVICE" numba >needs.txt \
    && python3 -m venv --without-pip /opt/treenail \
    && bin/pip --python /opt/treenail/bin/python install --quiet --require-hashes -r needs.txt \
    && find /opt/treenail -depth -type d -name tests -exec rm -r {} +
# Arithmetic as machine code, ART2's and the felt model's: an image is two thirds smaller without the compiler.
COPY services/classifier/art2_kernel.py services/classifier/compile_kernel.py services/classifier/
COPY services/agent/felt_kernel.py services/agent/compile_kernel.py services/agent/
COPY services/rules/compiled.py services/rules/
RUN mkdir compiled \
    && case "$SERVICE" in agent|classifier|cli) \
        python3 needs.py classifier >compiler.txt \
        && bin/pip install --quiet --require-hashes -r compiler.txt;; \
    esac \
    && case "$SERVICE" in classifier|cli) bin/python -m services.classifier.compile_kernel /build/compiled;; esac \
    && case "$SERVICE" in agent|cli) bin/python -m services.agent.compile_kernel /build/compiled;; esac
COPY services services
COPY experiments experiments
COPY treenail treenail
RUN find compiled -name 'art2*.so' -exec cp {} services/classifier/ \; \
    && find compiled -name 'felt*.so' -exec cp {} services/agent/ \; \
    && bin/pip wheel --quiet --no-deps --no-build-isolation --wheel-dir dist . \
    && bin/pip --python /opt/treenail/bin/python install --quiet --no-deps dist/treenail-*.whl

FROM python
ARG SERVICE
# SAPIEN is linked with X11 even where it draws nothing.
RUN if [ "$SERVICE" = sim ]; then \
        apt-get update && apt-get install -y --no-install-recommends libx11-6 \
        && apt-get clean && rm -rf /var/lib/apt/lists/*; \
    fi
COPY --from=installed /opt/treenail /opt/treenail
# What the store writes; a named volume takes its owner from here.
RUN mkdir /data && chown 10001:10001 /data
USER 10001:10001
WORKDIR /data
ENV PATH=/opt/treenail/bin:$PATH \
    PYTHONUNBUFFERED=1 \
    PYTHONDONTWRITEBYTECODE=1 \
    HOME=/tmp \
    TREENAIL_HEARTBEAT_FILE=/tmp/heartbeat
# The work loop touches the file every second; one that hangs does not.
HEALTHCHECK --interval=5s --timeout=3s --start-period=60s --retries=3 \
    CMD find /tmp/heartbeat -newermt "10 seconds ago" | grep -q .
ENTRYPOINT ["treenail"]
