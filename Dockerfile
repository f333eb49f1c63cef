# docker build -t indent-sim .                               Debian 13
# docker build -t indent-sim --build-arg DEBIAN=bookworm .   Debian 12
# docker run --rm -u "$(id -u):$(id -g)" -v "$PWD:/work" indent-sim run scene.yaml
# docker run --rm --entrypoint make -w /opt/indent-sim indent-sim test
ARG DEBIAN=trixie
FROM debian:${DEBIAN}-slim

LABEL org.opencontainers.image.title="indent-sim" \
      org.opencontainers.image.description="Finite-element simulation of indentation tests" \
      org.opencontainers.image.licenses="MIT"

WORKDIR /opt/indent-sim
COPY packages-debian.txt ./
COPY scripts/setup scripts/provision scripts/
RUN scripts/provision packages

COPY . .
RUN scripts/provision user \
 && mkdir -p /work && chown indent: /work \
 && rm -rf /home/indent/.cache /home/indent/.config && chmod 1777 /home/indent /work

# Any user id may run the image: compiled kernels and pictures need a home that it can write.
# Open MPI's direct copies between ranks need a privilege that containers do not have.
ENV HOME=/home/indent \
    OMPI_MCA_btl_vader_single_copy_mechanism=none
USER indent
WORKDIR /work
ENTRYPOINT ["/opt/indent-sim/.venv/bin/indent-sim"]
CMD ["--help"]
